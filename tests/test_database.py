"""Motion databases: what is in them, how they grow, and what they refuse."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from realdata import real_data

import evalkit
from evalkit import Capture, EvalkitError
from evalkit.cli import app
from evalkit.control import takes as takes_module
from evalkit.control.database import STILL, _spread, add_takes, build_database, open_database
from evalkit.control.takes import TakeOptions, database_take
from evalkit.studies.control_takes import RIGID_SITES, control_take
from evalkit.vision.markers import frontal_markers
from evalkit.vision.parameters import NAMES, control_parameters, denormalise, normalise

HEAD, FRAMES = "template 3000", 480
BONE = tuple(RIGID_SITES)


@pytest.fixture(scope="module")
def acted():
    return [control_take(HEAD, seed, FRAMES) for seed in range(3)]


@pytest.fixture(scope="module")
def stills(acted):
    return {f"take {k}": take.still for k, take in enumerate(acted)}


@pytest.fixture(scope="module")
def built(stills, tmp_path_factory):
    return build_database(stills, tmp_path_factory.mktemp("db") / "db", compensated=True, rigid=BONE, performer="one")


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}


def with_points(take, change):
    points = take.points.copy()
    change(points)
    return Capture(points=points, labels=take.labels, rate=take.rate)


def turned_onto(source, target):
    """Source (n, 3) after the rigid motion by least squares that brings it nearest to the target."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    return a @ turn + target.mean(axis=0)


# --- what is in it -----------------------------------------------------------------------------------------


def test_rows_are_the_markers_of_the_takes(built, acted):
    """Rest and displacement together are the true places, but for one rigid motion of a take."""
    assert built.rows == 3 * FRAMES and built.labels == tuple(acted[0].capture.labels)
    assert built.segments.tolist() == [[0, 480], [480, 960], [960, 1440]]
    for stored, take in zip(built.takes, acted, strict=True):
        places = (stored.rest_mm + built.motions[stored.start : stored.stop]).reshape(-1, 3)
        true = take.expression.reshape(-1, 3)
        # Single precision of displacements up to 30 mm.
        np.testing.assert_allclose(turned_onto(places, true), true, rtol=0, atol=1e-4)
        # Control: the places of another take are not these.
        other = acted[(int(stored.name[-1]) + 1) % 3].expression.reshape(-1, 3)
        assert np.abs(turned_onto(places, other) - other).max() > 1.0
    bone = [built.labels.index(label) for label in BONE]
    np.testing.assert_allclose(built.rest_mm[bone].mean(axis=0), 0.0, atol=1e-9)


def test_axes_are_those_of_the_front(built):
    at = dict(zip(built.labels, built.rest_mm, strict=True))
    assert at["mouth corner left"][0] > 20 and at["mouth corner right"][0] < -20
    assert at["Chin"][1] < at["nose tip"][1] < at["ForeheadC"][1] and at["nose tip"][2] > at["CheekL"][2]


def test_parameters_are_those_of_the_frontal_points(built, stills):
    changes = np.load(built.folder / "changes.npy")
    for stored in built.takes:
        found = denormalise(built.parameters[stored.start : stored.stop], stored.neutral, built.spread)
        true = frontal_markers(stills[stored.name]).parameters
        # Single precision of angles up to 20 degrees.
        np.testing.assert_allclose(found, true, rtol=0, atol=1e-5)
    spread = changes.std(axis=0)
    np.testing.assert_allclose(built.spread, np.maximum(spread, STILL), rtol=1e-5)
    assert (spread < STILL).any() and (spread > STILL).any()  # both kinds are there
    assert built.known.all() and built.unknown_parameters == []


def test_the_rest_is_the_face_that_the_neutral_parameters_are_of(built):
    """Both are found from the take; they must mean the same face."""
    from evalkit.vision.points import FACE_POINTS

    for stored in built.takes:
        places = stored.rest_mm[[built.labels.index(name) for name in FACE_POINTS]]
        unit = np.linalg.norm(places[4:6].mean(axis=0)[:2] - places[8:10].mean(axis=0)[:2])
        at_rest = control_parameters(places[None, :, :2], float(unit))
        away = normalise(at_rest, stored.neutral, built.spread)
        # The median of ten shapes is none of them: they scatter by a quarter of a spread, both medians lie among them.
        assert np.abs(away).max() < 0.25


def test_a_take_may_begin_at_rest(stills, acted):
    """Whatever it does afterwards: here it hardly ever is at rest again."""
    frames = stills["take 0"].points
    points = np.concatenate([np.repeat(acted[0].rest[None], 30, axis=0), frames])
    take = Capture(points=points, labels=stills["take 0"].labels, rate=60.0)
    told, found = (database_take(take, "take", TakeOptions(neutral_s=s), True, BONE) for s in (0.5, 0.0))
    rest = acted[0].rest - acted[0].rest[[take.labels.index(label) for label in BONE]].mean(axis=0)
    # The median of equal shapes, turned to the front; a turn keeps lengths.
    np.testing.assert_allclose(np.linalg.norm(told.rest_mm, axis=1), np.linalg.norm(rest, axis=1), atol=1e-9)
    assert np.abs(told.motions[:30]).max() < 1e-4 and np.abs(told.changes[:30]).max() < 1e-4
    # Control: left to itself it takes the face that it dwells in.
    assert np.abs(found.motions[:30]).max() > 0.5
    with pytest.raises(EvalkitError, match=r"take: no frame of its first 0\.2 s shows all markers"):
        gone = with_points(take, lambda points: points.__setitem__((slice(0, 20), 30), np.nan))
        database_take(gone, "take", TakeOptions(neutral_s=0.2), True, BONE)


def test_head_motion_is_undone(acted, tmp_path):
    moved = control_take(HEAD, 0, FRAMES, motion_deg=15.0, noise_mm=0.1)
    errors = []
    for compensated in (False, True):
        take = database_take(moved.capture, "take", TakeOptions(), compensated, BONE)
        off = take.motions - take.motions.mean(axis=0) - (moved.expression - moved.expression.mean(axis=0))
        errors.append(np.sqrt((off**2).sum(axis=2).mean()))
    # 0.17 mm are the noise itself; nine markers hold the head by 0.1 deg, which is 0.1 mm at the chin, and the front
    # of two takes differs by 2 deg, which is 3 % of what moves.
    assert errors[0] < 0.6
    # Control: what is said to be compensated and is not.
    assert errors[1] > 5.0


# --- gaps, jumps and rates ---------------------------------------------------------------------------------


def test_gaps_end_segments_and_short_ones_are_bridged(stills):
    still = stills["take 0"]

    def gaps(points):
        points[100:103, 7] = np.nan  # 50 ms
        points[200:230, 3] = np.nan  # half a second
        points[460:, 5] = np.nan  # to the end
        points[445, 9] = np.nan

    take = database_take(with_points(still, gaps), "take", TakeOptions(), True, BONE)
    assert take.segments.tolist() == [[0, 200], [200, 430]] and take.frames == FRAMES
    whole = database_take(still, "take", TakeOptions(), True, BONE)
    same = np.ones(FRAMES, dtype=bool)
    same[[*range(200, 230), *range(460, 480)]] = False
    moved = take.motions[1:] - take.motions[0]
    expected = (whole.motions - whole.motions[0])[same][1:]
    line = whole.motions[99, 7] + (whole.motions[103, 7] - whole.motions[99, 7]) * [[0.25], [0.5], [0.75]]
    expected[99:102, 7] = line - whole.motions[0, 7]
    expected[np.flatnonzero(same)[1:] == 445, 9] = moved[np.flatnonzero(same)[1:] == 445, 9]
    # The front of the take is found without the frames that are left out, too: it turns by a tenth of a degree.
    np.testing.assert_allclose(moved, expected, atol=0.3)
    assert take.bridged == pytest.approx(4 / take.motions[..., 0].size, rel=1e-6)


def test_a_jump_is_no_motion(stills):
    def jump(points):
        points[150:152, 20] += 40.0

    take = database_take(with_points(stills["take 0"], jump), "take", TakeOptions(), True, BONE)
    whole = database_take(stills["take 0"], "take", TakeOptions(), True, BONE)
    np.testing.assert_allclose(take.motions, whole.motions, atol=1.0)
    assert take.bridged > 0


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.lists(st.booleans(), min_size=1, max_size=40), st.integers(0, 6))
def test_short_gaps_are_told_from_long_ones(missing, most):
    def slow(k):
        first = last = k
        while first > 0 and missing[first - 1]:
            first -= 1
        while last < len(missing) - 1 and missing[last + 1]:
            last += 1
        return first > 0 and last < len(missing) - 1 and last - first + 1 <= most

    gaps = np.array(missing)[:, None]
    found = takes_module._no_longer(gaps, most)[:, 0] & gaps[:, 0]
    assert found.tolist() == [bool(gap and slow(k)) for k, gap in enumerate(missing)]


def test_takes_of_another_rate_are_resampled(stills, tmp_path):
    still = stills["take 0"]
    half = Capture(points=still.points[::2], labels=still.labels, rate=still.rate / 2)
    fast = database_take(still, "take", TakeOptions(rate_hz=30.0), True, BONE)
    slow = database_take(half, "take", TakeOptions(rate_hz=30.0), True, BONE)
    assert fast.own_rate_hz == 60.0 and fast.rate_hz == slow.rate_hz == 30.0
    moves = [take.motions - take.motions[0] for take in (fast, slow)]
    # The fronts of the two takes are medians over other frames.
    np.testing.assert_allclose(moves[0], moves[1], atol=0.05)
    up = takes_module._resampled(half.points, 30.0, 60.0)
    np.testing.assert_allclose(up[::2], half.points)
    np.testing.assert_allclose(up[1::2], 0.5 * (half.points[:-1] + half.points[1:]))


# --- growing -----------------------------------------------------------------------------------------------


def test_a_grown_database_is_that_built_at_once(built, stills, tmp_path):
    part = dict(list(stills.items())[:1])
    grown = build_database(part, tmp_path / "grown", compensated=True, rigid=BONE, performer="one")
    before = np.array(grown.parameters[:5])
    after = add_takes(grown, dict(list(stills.items())[1:]), compensated=True, rigid=BONE, performer="one")
    assert contents(after.folder) == contents(built.folder) and after.digest == built.digest
    # Who has it open goes on with what it was, though its spread is another one by now.
    np.testing.assert_array_equal(grown.parameters[:5], before)
    assert (grown.spread != after.spread).any() and grown.rows == FRAMES


def test_the_digest_is_that_of_the_contents(built, stills, tmp_path):
    again = build_database(stills, tmp_path / "again", compensated=True, rigid=BONE, performer="one")
    assert again.digest == built.digest

    def moved(points):
        points[7, 30] += 1e-3

    other = stills | {"take 1": with_points(stills["take 1"], moved)}
    assert build_database(other, tmp_path / "o", compensated=True, rigid=BONE, performer="one").digest != built.digest


@settings(derandomize=True, max_examples=30, deadline=None)
@given(st.lists(st.integers(2, 30), min_size=1, max_size=5), st.floats(0, 1000), st.integers(0, 1000))
def test_the_spread_of_takes_together_is_that_of_all_rows(counts, offset, seed):
    random = np.random.default_rng(seed)
    parts = [offset + random.standard_normal((n, 15)) * random.uniform(0, 5) + random.uniform(-9, 9) for n in counts]
    row, entries = 0, []
    for part in parts:
        mean = part.mean(axis=0)
        entries.append({"rows": [row, row + len(part)], "mean": mean, "m2": ((part - mean) ** 2).sum(axis=0)})
        row += len(part)
    found = _spread(entries, np.arange(15) > 0)
    np.testing.assert_allclose(found[1:], np.maximum(np.concatenate(parts).std(axis=0), STILL)[1:], rtol=1e-9)
    assert found[0] == 1.0


@pytest.mark.slow
def test_jobs_and_clusters_make_the_same_files(built, acted, tmp_path):
    paths = []
    for k, take in enumerate(acted):
        paths.append(tmp_path / f"take {k}.c3d")
        evalkit.write_capture(take.still, paths[-1])
    one = build_database(paths, tmp_path / "one", compensated=True, rigid=BONE)
    two = build_database(paths, tmp_path / "two", compensated=True, rigid=BONE, jobs=2)
    assert contents(one.folder) == contents(two.folder)
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        three = build_database(paths, tmp_path / "3", compensated=True, rigid=BONE, scheduler=cluster.scheduler_address)
    assert contents(one.folder) == contents(three.folder)


MEMORY = """
import sys, numpy as np
from pathlib import Path
from evalkit.capture import Capture
from evalkit.control.database import build_database
from evalkit.studies.control_takes import RIGID_SITES, control_take
sys.path.insert(0, sys.argv[2])
from peak_memory import resident_mb
still = control_take("template 3000", 0, 60_000).still
hoard = []
def takes(count):
    random = np.random.default_rng(0)
    for k in range(count):
        points = still.points + 0.1 * random.standard_normal((1, *still.points.shape[1:])) * (1 + 0.1 * still.points)
        if sys.argv[3] == "hoard":
            hoard.append(points)
        yield Capture(points=points, labels=still.labels, rate=still.rate)
folder = Path(sys.argv[1])
one = build_database(takes(1), folder / "1", compensated=True, rigid=tuple(RIGID_SITES))
first = resident_mb("VmHWM")
many = build_database(takes(int(sys.argv[4])), folder / "many", compensated=True, rigid=tuple(RIGID_SITES))
print(first, resident_mb("VmHWM"), sum(p.stat().st_size for p in many.folder.iterdir()) / 1e6)
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_database(tmp_path, record_property):
    """2.2 GB are built in the memory that one take of 60,000 frames needs."""

    def measured(kind, count):
        command = [sys.executable, "-c", MEMORY, str(tmp_path / kind), str(Path(__file__).parent), kind, str(count)]
        (tmp_path / kind).mkdir()
        ran = subprocess.run(command, capture_output=True, text=True, check=True)
        return map(float, ran.stdout.split())

    one, many, size = measured("streamed", 50)
    record_property("peak of one take, MB", one)
    record_property("peak of all, MB", many)
    record_property("database, MB", size)
    assert size > 2000
    # Mapped pages that are being written count as resident until the system takes them back: the parameters' 180 MB.
    assert many - one < 0.15 * size
    # Control: a build that keeps its captures is noticed.
    one, many, size = measured("hoard", 8)
    assert many - one > 0.5 * size


# --- what is refused ---------------------------------------------------------------------------------------


def test_captures_that_are_no_take_of_it(built, stills, tmp_path):
    """One line that names the take; files of the database stay as they were."""
    still = stills["take 0"]
    before = contents(built.folder)
    fewer = Capture(points=still.points[:, :-1], labels=still.labels[:-1], rate=still.rate)
    strange = Capture(points=still.points, labels=[f"M{k}" for k in range(51)], rate=still.rate)
    holes = with_points(still, lambda points: points.__setitem__((slice(None, None, 20), 0), np.nan))
    # Gaps of one frame each are bridged; with every marker on its own the take is torn.
    torn = with_points(still, lambda points: points.__setitem__((np.arange(480) % 30 < 12, 12), np.nan))
    never = with_points(still, lambda points: points.__setitem__((slice(None), 44), np.nan))
    for captures, text in (
        ({"a": fewer}, f"a: no marker '{still.labels[-1]}', which the database has"),
        ({"b": strange}, "b: marker 'ForeheadC' is not in the capture"),
        ({"c": torn}, "c: no 0.5 s of motion in which all 51 markers are seen"),
        ({"d": never}, f"d: marker '{still.labels[44]}' is never seen"),
        ({"take 1": holes}, "take 1: the database has a take of this name"),
        ({"copy": still}, "copy: holds the same motion as the take 'take 0'"),
        ([tmp_path / "nowhere.c3d"], "nowhere.c3d: no such file"),
        ([], "no captures"),
    ):
        with pytest.raises(EvalkitError) as caught:
            add_takes(built, captures, compensated=True, rigid=BONE)
        assert text in str(caught.value) and "\n" not in str(caught.value)
        assert contents(built.folder) == before


def test_nothing_is_left_of_a_build_that_fails(stills, tmp_path):
    output = tmp_path / "deep" / "db"
    broken = {"good": stills["take 0"], "bad": tmp_path / "nowhere.c3d"}
    for captures in (broken, [], iter(())):
        with pytest.raises(EvalkitError):
            build_database(captures, output, compensated=True, rigid=BONE)
        assert not (tmp_path / "deep").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(EvalkitError, match="is a file, not a folder"):
        build_database(stills, tmp_path / "file")
    for option in ({"rate_hz": -1.0}, {"gap_s": float("nan")}, {"jobs": 0}):
        with pytest.raises(EvalkitError):
            build_database(stills, output, compensated=True, **option)
    with pytest.raises(EvalkitError, match="no dask scheduler answers"):
        pytest.importorskip("distributed")
        build_database(stills, output, compensated=True, rigid=BONE, scheduler="inproc://nowhere/1")


def test_a_database_is_not_overwritten(built, stills):
    before = contents(built.folder)
    with pytest.raises(EvalkitError, match="holds a database already"):
        build_database(stills, built.folder)
    assert contents(built.folder) == before


@pytest.fixture
def copy(built, tmp_path):
    import shutil

    return Path(shutil.copytree(built.folder, tmp_path / "copy"))


def test_folders_that_are_no_database(copy, tmp_path):
    def told(folder):
        with pytest.raises(EvalkitError) as caught:
            open_database(folder)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    def rewritten(**changes):
        manifest = json.loads(text) | changes
        (copy / "takes.json").write_text(json.dumps(manifest))

    text = (copy / "takes.json").read_text()
    assert "no such folder" in told(tmp_path / "nowhere")
    assert "holds no motion database" in told(tmp_path)
    (copy / "takes.json").write_text(text[:500])
    assert "cannot be read" in told(copy)
    (copy / "takes.json").write_text("[]")
    assert "cannot be read" in told(copy)
    for changes, words in (
        ({"format": "something else"}, "is 'something else', not a motion database"),
        ({"version": 2, "evalkit": "9.9"}, "made by evalkit 9.9, newer than this one"),
        ({"parameters": list(NAMES[:14])}, "built with other control parameters"),
        ({"takes": [{}]}, "is damaged"),
        ({"rows": 5000}, "is not what takes.json says"),
        ({"labels": ["a"]}, "is not what takes.json says"),
    ):
        rewritten(**changes)
        assert words in told(copy)
    (copy / "takes.json").write_text(text)
    open_database(copy)
    (copy / "motions.npy").write_bytes((copy / "motions.npy").read_bytes()[:-999])
    assert "motions.npy: cannot be read" in told(copy)
    (copy / "motions.npy").unlink()
    assert "motions.npy: cannot be read" in told(copy)


def test_other_markers_or_parameters_than_asked_for(built, stills, tmp_path):
    labels = list(built.labels)
    open_database(built.folder, labels, NAMES)
    with pytest.raises(EvalkitError, match="no marker 'Tooth'"):
        open_database(built.folder, ["Tooth", *labels[1:]])
    with pytest.raises(EvalkitError, match="another order"):
        open_database(built.folder, labels[::-1])
    with pytest.raises(EvalkitError, match="'smirk' is no control parameter"):
        open_database(built.folder, parameters=["smirk"])
    lidless = {
        name: Capture(points=np.delete(take.points, 7, axis=1), labels=labels[:7] + labels[8:], rate=take.rate)
        for name, take in stills.items()
    }
    other = build_database(lidless, tmp_path / "lidless", compensated=True, rigid=BONE)
    assert other.unknown_parameters == ["eye_left"]
    assert (other.parameters[:, ~other.known] == 0).all()
    with pytest.raises(EvalkitError, match="do not give eye_left"):
        open_database(other.folder, parameters=["eye_left"])
    with pytest.raises(EvalkitError, match="no marker 'lower lid left'"):
        add_takes(built, {"lidless": lidless["take 0"]}, compensated=True, rigid=BONE)


def test_a_killed_addition_leaves_the_database_whole(copy, stills, built):
    """Rows at the end that no description names are not there, and the next addition cuts them off."""
    with (copy / "motions.npy").open("ab") as file:
        file.write(b"\1" * 12_345)
    found = open_database(copy)
    np.testing.assert_array_equal(found.motions, built.motions)
    new = control_take(HEAD, 9, FRAMES).still
    grown = add_takes(found, {"new": new}, compensated=True, rigid=BONE)
    np.testing.assert_array_equal(grown.motions[: built.rows], built.motions)
    own = database_take(new, "new", TakeOptions(labels=built.labels, rate_hz=60.0), True, BONE)
    np.testing.assert_array_equal(grown.motions[built.rows :], own.motions)


def test_an_open_database_takes_no_memory(built):
    assert isinstance(built.motions, np.memmap) and isinstance(built.parameters, np.memmap)
    with pytest.raises(AttributeError):
        built.rate_hz = 30.0
    assert replace(built, rate_hz=30.0).rows == built.rows


# --- command line, real takes ------------------------------------------------------------------------------


def test_the_command_line(acted, tmp_path):
    paths = []
    for k in range(2):
        paths.append(str(tmp_path / f"take{k}.c3d"))
        evalkit.write_capture(acted[k].still, paths[-1])
    bone, output = ",".join(BONE), str(tmp_path / "db")

    def ran(*words):
        return CliRunner().invoke(app, ["database", *words])

    made = ran("build", paths[0], "-o", output, "--compensated", "--rigid", bone, "--performer", "anna")
    assert made.exit_code == 0, made.output
    assert "1 takes, 480 frames at 60 Hz" in made.output and "take0 (anna)" in made.output
    more = ran("add", output, paths[1], "--compensated", "--rigid", bone, "--graph", "20", "--json")
    assert json.loads(more.output)["rows"] == 960
    assert [path.name[:9] for path in Path(output).glob("graph-*")] == ["graph-20-"]
    facts = json.loads(ran("info", output, "--json").output)
    assert facts["digest"] == open_database(output).digest and facts["unknown_parameters"] == []
    assert [take["source"] for take in facts["takes"]] == ["take0.c3d", "take1.c3d"]
    wrong = ran("info", str(tmp_path))
    assert isinstance(wrong.exception, EvalkitError) and "holds no motion database" in str(wrong.exception)
    for verb in ("build", "add", "info"):
        assert "Example" in ran(verb, "--help").output


@pytest.mark.slow
def test_real_takes_make_a_database(tmp_path):
    """41 markers of a performer; all of them have every one of the fifteen parameters."""
    paths = [real_data("captures", f"animface_{name}.c3d") for name in ("jaw", "cheeks")]
    found = build_database(paths, tmp_path / "db", performer="one")
    assert found.rows == 1590 + 1499 and len(found.labels) == 41 and found.unknown_parameters == []
    at = dict(zip(found.labels, found.rest_mm, strict=True))
    assert at["Mouth_Lend"][0] > 0 > at["Mouth_Rend"][0] and at["Chin"][1] < at["NoseHead"][1]
    jaw = found.takes[0]
    opened = -found.motions[jaw.start : jaw.stop, found.labels.index("Chin"), 1]
    # The take of the jaw opens it by centimetres, and the lip opening says so.
    assert opened.max() > 10.0
    assert np.corrcoef(opened, found.parameters[jaw.start : jaw.stop, NAMES.index("lip_opening")])[0, 1] > 0.8


def test_a_take_that_the_command_writes_becomes_a_database(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["synth", "performer", "-o", "takes", "--seed", "4", "--set", "head=template 3000", "--set", "frames=240"]
    assert "takes/performer-4.c3d" in CliRunner().invoke(app, words, catch_exceptions=False).output
    truth = np.load("takes/performer-4.truth.npz")
    built = build_database(["takes/performer-4.c3d"], tmp_path / "db", rigid=tuple(truth["rigid"]))
    # The motion is in it: what is over bone hardly moves, the lips do.
    size = np.abs(built.motions - built.motions.mean(axis=0)).max(axis=(0, 2))
    assert size[built.labels.index("lower lip")] > 5.0 * size[built.labels.index("ForeheadM")]
    with pytest.raises(EvalkitError, match="did you mean 'frames'"):
        CliRunner().invoke(app, [*words, "--set", "frame=3"], catch_exceptions=False)
