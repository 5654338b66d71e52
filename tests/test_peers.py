"""Methods of other packages beside evalkit's own: right on whole data, and their failures said in their words."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import evalkit
from evalkit.errors import EvalkitError, FrameStatus
from evalkit.peers.calling import installed, words_of
from evalkit.pivot import pivot_estimators
from evalkit.pivot.algebraic import score
from evalkit.pose import pose_estimators, reference_pose

sys.path.insert(0, str(Path(__file__).parent / "contracts"))
from heads import PIVOT, SHAPE, about_one_axis, lose, seen, turning

POSES = {name: entry for name, entry in pose_estimators.items() if entry.peer}
PIVOTS = {name: entry for name, entry in pivot_estimators.items() if entry.peer}

pose_peer = pytest.mark.parametrize("name", POSES)
pivot_peer = pytest.mark.parametrize("name", PIVOTS)


def posed(points):
    return reference_pose(pose_estimators["svd"], points)


def pivot_of(name, points):
    return PIVOTS[name](points, posed(points))


def needs(name):
    if name not in POSES and name not in PIVOTS:
        pytest.skip(f"the package of {name} is not installed")


# --- the entries -------------------------------------------------------------------------------------------


def test_scipy_is_always_there():
    assert "peer-scipy" in POSES
    assert all(name.startswith("peer-") for name in (*POSES, *PIVOTS))


@pytest.mark.parametrize("name", [*POSES, *PIVOTS])
def test_a_peer_says_which_version_it_is(name):
    package, version = (POSES | PIVOTS)[name].origin.rsplit(" ", 1)
    assert package and version[0].isdigit()


def test_a_package_that_is_not_installed_is_not_there():
    assert installed("not_there_at_all", "not-there-at-all") == ""
    assert installed("scipy", "scipy").startswith("scipy ")


def test_tables_load_no_peer():
    """The import happens at the first call: a table that is merely listed costs nothing."""
    code = (
        "import sys\nfrom evalkit.pivot import pivot_estimators\nfrom evalkit.pose import pose_estimators\n"
        "len(pose_estimators), len(pivot_estimators)\n"
        "heavy = {'kineticstoolkit', 'sksurgerycalibration', 'biobuddy', 'cv2', 'PyQt5', 'matplotlib'}\n"
        "print(heavy & set(sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "set()"


def test_whatever_a_peer_raises_becomes_one_line_with_its_words():
    with pytest.raises(EvalkitError) as caught, words_of("that package"):
        raise ZeroDivisionError("two\nlines")
    assert str(caught.value) == "that package failed: ZeroDivisionError: two lines"
    with pytest.raises(EvalkitError, match=r"^ours$"), words_of("that package"):
        raise EvalkitError("ours")
    with pytest.raises(KeyboardInterrupt), words_of("that package"):
        raise KeyboardInterrupt


# --- the reduced contract ----------------------------------------------------------------------------------


@pose_peer
def test_pose_peers_recover_exactly_and_agree_with_ours(name):
    truth = turning()
    pose = POSES[name](SHAPE, seen(truth))
    assert pose.ok.all()
    # Rounding, as in the contract of our own.
    np.testing.assert_allclose(pose.rotations, truth, atol=1e-9)
    fitted = np.einsum("fij,mj->fmi", pose.rotations, SHAPE) + pose.translations[:, None]
    np.testing.assert_allclose(fitted, seen(truth), atol=1e-6)
    # Under noise each minimises what svd does, by its own code: an oracle that we did not write.
    noisy = seen(truth, noise=0.4)
    theirs, ours = POSES[name](SHAPE, noisy), pose_estimators["svd"](SHAPE, noisy)
    np.testing.assert_allclose(theirs.rotations, ours.rotations, atol=1e-9)
    np.testing.assert_allclose(theirs.translations, ours.translations, atol=1e-6)
    # Control: the same comparison notices a template that is a tenth of a millimetre off.
    off = pose_estimators["svd"](SHAPE + 0.1 * np.eye(len(SHAPE), 3), noisy)
    assert np.abs(off.rotations - theirs.rotations).max() > 1e-5


def test_scipy_takes_weights_as_ours_do():
    points, weights = seen(turning(), noise=0.4), np.array([1.0, 0.2, 3.0, 0.7, 1.5])
    theirs, ours = (pose_estimators[name](SHAPE, points, weights) for name in ("peer-scipy", "svd"))
    np.testing.assert_allclose(theirs.rotations, ours.rotations, atol=1e-9)
    np.testing.assert_allclose(theirs.translations, ours.translations, atol=1e-6)
    assert np.abs(theirs.rotations - pose_estimators["svd"](SHAPE, points).rotations).max() > 1e-4


@pivot_peer
def test_pivot_peers_recover_exactly(name):
    found = pivot_of(name, seen(turning()))
    assert found.status == "ok"
    # Algebra: rounding. The sphere is an iteration that stops at 1e-8 of the parameters, hundreds of mm.
    assert np.linalg.norm(found.position - PIVOT) < (1e-4 if name.endswith("sphere") else 1e-8)
    # They tell nothing of how sure they are, and nothing is made up for them.
    assert np.isnan(found.covariance).all() and np.isnan(found.principal_std).all()


@pivot_peer
def test_pivot_peers_follow_the_world(name):
    """The laboratory's origin may be metres away and must not matter: the body's own origin is handed over."""
    points, shift = seen(turning(), noise=0.1), np.array([2e3, -1.5e3, 3e3])
    a, b = pivot_of(name, points), pivot_of(name, points + shift)
    # The sphere: its tolerance again, relative to coordinates of metres.
    assert np.linalg.norm(b.position - shift - a.position) < (1e-2 if name.endswith("sphere") else 1e-6)


@pytest.mark.parametrize("name", ["peer-scikit-surgery-aos", "peer-biobuddy-score"])
def test_algebraic_peers_are_near_our_own_before_its_correction(name):
    """The same normal equations as our score without its correction; biobuddy then drops a part of the frames."""
    needs(name)
    points = seen(turning(400), noise=0.3)
    ours = score(points, posed(points), correct_bias=False).position
    apart = np.linalg.norm(pivot_of(name, points).position - ours)
    if name.endswith("aos"):
        assert apart < 1e-6  # the same minimum
    else:
        # Another choice of frames among 400: of the size of the estimate's own error, which is about 0.5 mm here.
        assert 1e-6 < apart < 1.0


# --- what they do with data that is not whole: findings, pinned --------------------------------------------


def test_scipy_says_that_it_cannot_bear_missing_markers():
    points = seen(turning())
    points[7, 2] = np.nan
    with pytest.raises(EvalkitError, match=r"^scipy align_vectors, frame 7, failed: \w+: .+") as caught:
        POSES["peer-scipy"](SHAPE, points)
    assert "\n" not in str(caught.value)


def test_kineticstoolkit_leaves_missing_markers_out_itself():
    needs("peer-kineticstoolkit")
    truth = turning()
    points = lose(seen(truth), 0.2)
    pose = POSES["peer-kineticstoolkit"](SHAPE, points)
    enough = np.isfinite(points[:, :, 0]).sum(axis=1) >= 3
    assert 0 < enough.sum() < len(points)
    np.testing.assert_array_equal(pose.ok, enough)
    assert (pose.status[~enough] == FrameStatus.TOO_FEW_MARKERS).all()
    np.testing.assert_allclose(pose.rotations[enough], truth[enough], atol=1e-9)
    with pytest.raises(EvalkitError, match="takes no weights"):
        POSES["peer-kineticstoolkit"](SHAPE, points, np.arange(1.0, 6.0))


@pivot_peer
def test_frames_without_a_pose_are_not_handed_over(name):
    points = seen(turning())
    holes = points.copy()
    holes[[3, 40, 41]] = np.nan
    found = pivot_of(name, holes)
    assert np.linalg.norm(found.position - PIVOT) < (1e-4 if name.endswith("sphere") else 1e-8)
    with pytest.raises(EvalkitError):
        PIVOTS[name](points, pose_estimators["svd"](SHAPE, np.full_like(points, np.nan)))


@pivot_peer
def test_peers_do_not_say_that_one_axis_hides_the_pivot(name):
    """What evalkit calls unobservable comes back from them as a position, or as an error in their words."""
    try:
        found = pivot_of(name, seen(about_one_axis((1.0, 0.0, 0.0)), noise=0.3))
    except EvalkitError as error:
        assert "failed: " in str(error) and "\n" not in str(error)
    else:
        assert found.status == "ok" and "no verdict" in found.message


@pytest.mark.parametrize("kind", ["pose", "pivot"])
def test_peers_work_from_compensate(kind):
    take, truth = evalkit.synthesize("talking", seed=0, frames=200)
    for name in POSES if kind == "pose" else PIVOTS:
        result = evalkit.compensate(take, list(truth.rigid), **{kind: name})
        ours = evalkit.compensate(take, list(truth.rigid), **{kind: "svd" if kind == "pose" else "score"})
        assert result.frame_status.tolist() == ours.frame_status.tolist()
        # 200 frames at ±20 degrees and 0.3 mm: all of them within some millimetres of the neck.
        assert np.linalg.norm(result.pivot - truth.pivot) < 10.0
