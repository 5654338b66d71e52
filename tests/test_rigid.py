"""Choice of the rigid markers: what varies least and stands far apart, and the evidence for it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import evalkit
from evalkit.capture import Capture
from evalkit.capture.rigid import choose_rigid, distance_variation
from evalkit.errors import EvalkitError


def face(frames=200, loose=6, stiff=5, noise=0.1, seed=0, sizes=60.0):
    """Stiff markers (labels S*) and loose ones (L*) that wander by millimetres, on a turning head, shuffled."""
    rng = np.random.default_rng(seed)
    rest = rng.normal(scale=sizes, size=(stiff + loose, 3))
    time = np.linspace(0.0, 20.0, frames)[:, None, None]
    wander = 5.0 * np.sin(time * rng.uniform(0.5, 2.0, (loose, 3)) + rng.uniform(0, 6, (loose, 3)))
    x = np.repeat(rest[None], frames, axis=0)
    x[:, stiff:] += wander
    turn = Rotation.from_rotvec(0.3 * np.sin(time[:, 0] * [0.7, 1.1, 0.5])).as_matrix()
    x = np.einsum("fij,fmj->fmi", turn, x) + 50.0 * np.sin(0.3 * time)
    x += noise * rng.standard_normal(x.shape)
    labels = [f"S{k}" for k in range(stiff)] + [f"L{k}" for k in range(loose)]
    order = rng.permutation(stiff + loose)
    return Capture(x[:, order], [labels[k] for k in order], 60.0)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5])
def test_the_stiff_markers_are_found(seed, noise):
    chosen = choose_rigid(face(seed=seed, noise=noise))
    assert chosen.automatic and set(chosen.labels) <= {f"S{k}" for k in range(5)}
    # Each further marker lowers the error of the rotation, so nearly all five are taken.
    assert len(chosen.labels) >= 4 or noise == 0.0
    take = face(seed=seed, noise=noise)
    assert [take.labels[c] for c in chosen.columns] == chosen.labels
    assert "\n" not in chosen.reason and "automatically" in chosen.reason


def test_control_loose_markers_are_taken_when_nothing_is_stiff():
    """The choice rests on the distances, not on the labels."""
    take = face(stiff=0, loose=8)
    assert all(label.startswith("L") for label in choose_rigid(take).labels)


def test_the_size_can_be_fixed():
    for size in (3, 4, 5):
        chosen = choose_rigid(face(seed=1), size=size)
        assert len(chosen.labels) == size and set(chosen.labels) <= {f"S{k}" for k in range(5)}


def test_markers_in_one_line_are_not_chosen():
    """Three steady markers in a line cannot give a rotation; a fourth, noisier, beside it can."""
    rng = np.random.default_rng(3)
    x = np.repeat(np.array([[0.0, 0, 0], [30, 0, 0], [60, 0, 0], [20, 50, 0]])[None], 100, axis=0)
    x[:, 3] += 0.3 * rng.standard_normal((100, 3))
    x[:, :3] += 0.01 * rng.standard_normal((100, 3, 3))
    assert "d" in choose_rigid(Capture(x, list("abcd"), 60.0)).labels
    with pytest.raises(EvalkitError, match="line"):
        choose_rigid(Capture(x[:, :3], list("abc"), 60.0))


def test_distances_and_their_variation_are_what_they_say():
    take = face(frames=50, seed=4)
    points = take.points.copy()
    points[::5, 2] = np.nan
    points[:, 4] = np.nan
    points[1:, 5] = np.nan
    mean, std = distance_variation(points)
    for i in range(points.shape[1]):
        for j in range(points.shape[1]):
            distances = [np.linalg.norm(f[i] - f[j]) for f in points if np.isfinite(f[i] + f[j]).all()]
            if not distances:
                assert np.isnan(mean[i, j]) and np.isnan(std[i, j])
                continue
            # Means of 50 numbers of 100 mm.
            assert mean[i, j] == pytest.approx(np.mean(distances), abs=1e-11)
            if len(distances) > 1:
                assert std[i, j] == pytest.approx(np.std(distances, ddof=1), abs=1e-10)
            else:
                assert np.isnan(std[i, j])


def test_evidence_of_a_named_choice():
    take = face(seed=5)
    chosen = choose_rigid(take, ["S0", "S3", "L1"])
    assert chosen.labels == ["S0", "S3", "L1"] and not chosen.automatic
    assert chosen.columns == take.indices(["S0", "S3", "L1"])
    # 0.1 mm per axis and marker are 0.14 mm of distance; the loose one wanders by millimetres.
    assert chosen.pair_std[0, 1] < 0.2 < 2.0 < chosen.pair_std[0, 2]


def test_markers_that_are_rarely_seen_are_not_chosen():
    take = face(seed=6)
    points = take.points.copy()
    points[: int(0.6 * take.frames), take.labels.index("S2")] = np.nan
    chosen = choose_rigid(take.with_points(points))
    assert "S2" not in chosen.labels and len(chosen.labels) >= 3


def test_markers_that_are_never_seen_together():
    take = face(seed=7)
    points = take.points.copy()
    points[::2, take.labels.index("S0")] = np.nan
    points[1::2, take.labels.index("S1")] = np.nan
    chosen = choose_rigid(take.with_points(points))
    assert set(chosen.labels) <= {f"S{k}" for k in range(5)} and not {"S0", "S1"} <= set(chosen.labels)
    assert evalkit.compensate(take.with_points(points), pivot="score").status in ("ok", "poorly-observable")


def test_many_markers_are_thinned_to_candidates_without_losing_the_stiff_ones():
    chosen = choose_rigid(face(stiff=7, loose=60, frames=120, seed=8))
    assert set(chosen.labels) <= {f"S{k}" for k in range(7)} and len(chosen.labels) >= 4


def test_order_of_markers_and_place_of_the_laboratory_do_not_matter():
    take = face(seed=9)
    order = np.random.default_rng(0).permutation(len(take.labels))
    other = Capture(take.points[:, order] + [5e3, -2e3, 1e3], [take.labels[k] for k in order], 60.0)
    assert set(choose_rigid(take).labels) == set(choose_rigid(other).labels)


@pytest.mark.parametrize("preset", ["talking", "clean", "gaps"])
def test_automatic_choice_never_moves_the_face_more_than_the_head_does(preset):
    """Against the truth: with the markers found, most of the head's motion is gone."""
    from evalkit.metrics import expression_error_mm, rms

    take, truth = evalkit.synthesize(preset, seed=1, frames=240)
    result = evalkit.compensate(take, pivot="score")
    raw = rms(expression_error_mm(take.points, truth.clean))
    assert rms(expression_error_mm(result.capture.points, truth.clean)) < 0.3 * raw


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_too_short_takes_say_so_in_one_line(frames):
    take = face()
    short = Capture(take.points[:frames], take.labels, 60.0)
    try:
        chosen = choose_rigid(short)
    except EvalkitError as error:
        assert "\n" not in str(error)
    else:
        assert frames == 2 and len(chosen.labels) >= 3


def test_takes_without_three_markers_say_so():
    take = face()
    with pytest.raises(EvalkitError, match="only 2 markers"):
        choose_rigid(Capture(take.points[:, :2], take.labels[:2], 60.0))
    angles = Capture(take.points, take.labels, 60.0, quantities=["angle"] * len(take.labels))
    with pytest.raises(EvalkitError, match="only 0 markers"):
        choose_rigid(angles)
