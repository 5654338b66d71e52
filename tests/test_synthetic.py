"""Synthetic captures: the take against its truth, and the truth against independent calculations."""

import hashlib
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from evalkit.errors import EvalkitError
from evalkit.seeds import generator, seed_sequence
from evalkit.synthetic import PRESETS, Parameters, Truth, parse_overrides, synthesize, write_synthetic
from evalkit.synthetic.expression import ACTION_NAMES
from evalkit.synthetic.performer import make_performer


def angles_by_hand(rotation):
    """Nod, turn, tilt in degrees from R = Ry(turn) Rx(nod) Rz(tilt), by the entries of the matrix."""
    nod = -np.arcsin(rotation[1, 2])
    turn = np.arctan2(rotation[0, 2], rotation[2, 2])
    tilt = np.arctan2(rotation[1, 0], rotation[1, 1])
    return np.degrees([nod, turn, tilt])


def power_above(signal, rate, frequency):
    """Share of the power of a (F, ...) signal, without its mean, above a frequency."""
    signal = signal.reshape(len(signal), -1)
    signal = (signal - signal.mean(axis=0)) * np.hanning(len(signal))[:, None]
    power = (np.abs(np.fft.rfft(signal, axis=0)) ** 2).sum(axis=1)
    return power[np.fft.rfftfreq(len(signal), 1 / rate) > frequency].sum() / power.sum()


def rigid_columns(truth):
    return [truth.labels.index(label) for label in truth.rigid]


@pytest.mark.parametrize("preset", PRESETS)
def test_observation_is_the_model_applied_to_the_truth(preset):
    take, truth = synthesize(preset, seed=3, noise=0.0, frames=90)
    expected = np.full(take.points.shape, np.nan)
    for i in range(take.frames):
        for m in range(len(take.labels)):
            if truth.visible[i, m]:
                k = truth.identity[i, m]
                p = truth.neutral[k] + truth.expression[i, k]
                expected[i, m] = truth.rotations[i] @ (p - truth.pivot) + truth.pivot + truth.sway[i]
    sound = truth.visible & ~truth.outliers
    # Rounding of numbers of 2 m, or half a step of the grid.
    tolerance = max(1e-9, 0.501 * truth.parameters["quantum_mm"])
    np.testing.assert_allclose(take.points[sound], expected[sound], rtol=0, atol=tolerance)
    assert np.array_equal(take.visible, truth.visible)
    short = np.einsum("fij,fmj->fmi", truth.rotations, truth.clean) + truth.translations[:, None]
    named = truth.visible & ~truth.swapped
    np.testing.assert_allclose(short[named], expected[named], rtol=0, atol=1e-9)


@pytest.mark.parametrize("preset", PRESETS)
def test_rotations_are_proper_and_reach_the_stated_range(preset):
    _, truth = synthesize(preset, seed=1)
    np.testing.assert_allclose(np.linalg.det(truth.rotations), 1.0, atol=1e-12)
    angles = np.array([angles_by_hand(rotation) for rotation in truth.rotations])
    np.testing.assert_allclose(np.abs(angles).max(axis=0), truth.parameters["range_deg"], atol=1e-9)
    assert np.abs(truth.rotations[0] - np.eye(3)).max() > 1e-4


@pytest.mark.parametrize("frames", [1, 2, 30, 5000])
def test_takes_of_any_length_reach_the_range(frames):
    take, truth = synthesize("sway", seed=2, frames=frames, range_deg=(7, 3, 1))
    assert take.points.shape == (frames, 23, 3)
    angles = np.array([angles_by_hand(rotation) for rotation in truth.rotations])
    np.testing.assert_allclose(np.abs(angles).max(axis=0), (7, 3, 1), atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_head_moves_like_a_head(seed):
    _, truth = synthesize("talking", seed=seed)
    steps = truth.rotations[1:] @ truth.rotations[:-1].transpose(0, 2, 1)
    cosine = (np.trace(steps, axis1=1, axis2=2) - 1) / 2
    speed = np.degrees(np.arccos(np.clip(cosine, -1, 1))) * truth.rate
    assert 30 < speed.max() < 200
    assert (speed < 10).mean() > 0.1  # pauses
    assert power_above(truth.rotations, truth.rate, 6.0) < 1e-3


def test_white_motion_would_not_pass_as_a_head():
    white = np.random.default_rng(0).standard_normal((600, 3))
    assert power_above(white, 60.0, 6.0) > 0.5


def test_single_axis_turns_about_exactly_one_axis():
    _, truth = synthesize("single-axis", seed=4)
    x = np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(truth.rotations @ x, np.tile(x, (600, 1)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.swapaxes(truth.rotations, 1, 2) @ x, np.tile(x, (600, 1)), rtol=0, atol=1e-15)


def test_layout_is_that_of_an_adult_face():
    take, truth = synthesize("clean")
    place = dict(zip(truth.labels, truth.neutral, strict=True))
    assert len(take.labels) == len(set(take.labels)) == 23
    triangle = truth.neutral[rigid_columns(truth)]
    edges = np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1)
    assert ((edges > 35) & (edges < 50)).all()
    assert 170 < np.linalg.norm(triangle.mean(axis=0) - truth.pivot) < 200
    assert 40 < place["MouthL"][0] - place["MouthR"][0] < 65
    assert place["BrowOutL"][0] > place["BrowInL"][0] > place["BrowInR"][0] > place["BrowOutR"][0]
    order = ["ForeheadC", "BrowInL", "LidL", "CheekL", "UpperLipC", "LowerLipC", "Chin"]
    heights = [place[label][1] for label in order]
    assert heights == sorted(heights, reverse=True)
    assert truth.pivot[2] < min(site[2] for site in place.values()) - 60  # the neck is behind the face
    assert 1200 < truth.neutral[:, 1].mean() < 1700  # a person standing on the floor of a laboratory


def test_left_and_right_mirror_each_other():
    performer = make_performer()
    place = dict(zip(performer.labels, performer.sites, strict=True))
    for label, site in place.items():
        if label.endswith("L"):
            np.testing.assert_array_equal(place[label[:-1] + "R"], site * [-1, 1, 1])


def test_performers_differ_and_are_the_same_whenever_asked_for():
    first, second = make_performer(number=1), make_performer(number=2)
    assert np.abs(first.sites - second.sites).max() > 2
    assert np.array_equal(first.sites, make_performer(number=1).sites)
    for number in range(1, 40):
        performer = make_performer(number=number)
        forehead = performer.sites[:3].mean(axis=0)
        assert 140 < np.linalg.norm(forehead - performer.pivot) < 215


def test_rigid_markers_keep_their_distances_unless_the_skin_slides():
    for preset, rigid in (("clean", True), ("skin", False)):
        take, truth = synthesize(preset, seed=5, noise=0.0)
        points = take.points[:, rigid_columns(truth)]
        spread = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).std(axis=0).max()
        assert (spread < 1e-10) == rigid
        assert (truth.rigid_slide_mm == 0) == rigid


def test_skin_slide_is_coherent_and_of_the_stated_size():
    _, truth = synthesize("skin", seed=0, skin=5.0, actions=("brow_raise",), frames=3600)
    slide = truth.expression[:, rigid_columns(truth)]
    assert 2.0 < truth.rigid_slide_mm < 5.0 * 1.2
    up = slide[:, :, 1]
    assert (up >= 0).all()
    moving = up.max(axis=1) > 0.1
    correlation = np.corrcoef(up[moving].T)
    assert correlation.min() > 0.999  # all three go together: their distances hide most of it
    assert (np.abs(slide[~moving]) < 0.2).all()


def test_sway_is_slow_centred_and_of_the_stated_size():
    _, truth = synthesize("sway", seed=6, frames=12000)
    assert np.abs(truth.sway.mean(axis=0)).max() < 1e-9
    assert np.linalg.norm(truth.sway, axis=1).max() == pytest.approx(20.0, rel=1e-6)
    assert power_above(truth.sway, truth.rate, 0.3) < 1e-3
    white = np.random.default_rng(0).standard_normal(truth.sway.shape)
    assert power_above(white, truth.rate, 0.3) > 0.9
    _, fixed = synthesize("talking", seed=6)
    assert not fixed.sway.any()


def test_noise_has_the_stated_level_and_is_white():
    silent, _ = synthesize("clean", seed=7, frames=4000)
    noisy, truth = synthesize("clean", seed=7, frames=4000, noise=0.3)
    noise = noisy.points - silent.points
    assert truth.noise_mm == 0.3
    # 276,000 draws: the standard error of the standard deviation is 0.0004 mm.
    assert noise.std() == pytest.approx(0.3, abs=0.002)
    assert abs(noise.mean()) < 0.003
    per_axis = noise.reshape(4000, -1).std(axis=0)
    assert per_axis.min() > 0.28
    assert per_axis.max() < 0.32
    lagged = (noise[1:] * noise[:-1]).mean() / noise.var()
    assert abs(lagged) < 0.01
    assert power_above(noise, 60.0, 15.0) == pytest.approx(0.5, abs=0.02)


def test_expressions_are_not_white():
    take, truth = synthesize("talking", seed=8, frames=3600)
    assert power_above(truth.expression, take.rate, 12.0) < 0.005
    white = np.random.default_rng(0).standard_normal(truth.expression.shape)
    assert power_above(white, take.rate, 12.0) > 0.5


def test_every_action_moves_the_markers_it_should():
    expected = {
        "jaw_open": ("Chin", -1),
        "smile": ("MouthL", +1),
        "brow_raise": ("BrowOutL", +1),
        "frown": ("BrowInL", -1),
        "blink": ("LidR", -1),
    }
    for action in ACTION_NAMES:
        _, truth = synthesize("clean", seed=9, actions=(action,))
        size = np.linalg.norm(truth.expression, axis=2).max(axis=0)
        assert 2 < size.max() < 35, action
        assert not truth.expression[:, rigid_columns(truth)].any()
        if action in expected:
            label, sign = expected[action]
            m = truth.labels.index(label)
            vertical = truth.expression[:, m, 1]
            assert sign * vertical[np.abs(vertical).argmax()] > 1.5, action
    _, pucker = synthesize("clean", seed=9, actions=("pucker",))
    width = pucker.clean[:, pucker.labels.index("MouthL"), 0] - pucker.clean[:, pucker.labels.index("MouthR"), 0]
    assert width.min() < width.max() - 4


def test_lips_do_not_cross():
    for seed in range(6):
        _, truth = synthesize("talking", seed=seed, performer=seed)
        for side in "CLR":
            upper = truth.clean[:, truth.labels.index(f"UpperLip{side}"), 1]
            lower = truth.clean[:, truth.labels.index(f"LowerLip{side}"), 1]
            assert (upper - lower).min() > 10


def test_expression_strength_scales_the_face_and_zero_stills_it():
    _, none = synthesize("clean", seed=9, expression=0.0)
    assert not none.expression.any()
    _, half = synthesize("clean", seed=9, expression=0.5)
    _, full = synthesize("clean", seed=9)
    lid = full.labels.index("LidL")
    np.testing.assert_allclose(2 * half.expression[:, lid], full.expression[:, lid], atol=1e-12)


def test_gaps_have_the_stated_share_and_lengths():
    shares = []
    for fraction in (0.05, 0.3, 0.8):
        take, truth = synthesize("gaps", seed=10, frames=20000, gaps=fraction)
        assert np.array_equal(take.visible, truth.visible)
        shares.append((~truth.visible).mean())
        per_marker = (~truth.visible).mean(axis=0)
        assert per_marker.min() > 0.7 * fraction  # every marker, the rigid ones too
    np.testing.assert_allclose(shares, (0.05, 0.3, 0.8), rtol=0.1)
    _, bursts = synthesize("gaps", seed=10, frames=20000, gaps=0.1, gap_bursts=1.0, gap_length=20)
    edges = np.diff(np.pad(~bursts.visible, ((1, 1), (0, 0))).astype(int), axis=0)
    assert (~bursts.visible).sum() / (edges == 1).sum() == pytest.approx(20, rel=0.15)
    _, singles = synthesize("gaps", seed=10, frames=20000, gaps=0.1, gap_bursts=0.0)
    edges = np.diff(np.pad(~singles.visible, ((1, 1), (0, 0))).astype(int), axis=0)
    assert (~singles.visible).sum() / (edges == 1).sum() == pytest.approx(1 / 0.9, rel=0.02)


def test_parts_have_streams_of_their_own():
    take, truth = synthesize("talking", seed=11)
    same = {"rotations", "pivot", "sway", "neutral", "expression", "visible"}
    changes = {
        "noise": (1.0, set()),
        "gaps": (0.2, {"visible"}),
        "sway": (5.0, {"sway"}),
        "skin": (3.0, {"expression"}),
        "expression": (0.5, {"expression"}),
        "range_deg": ((5, 5, 5), {"rotations"}),
    }
    for name, (value, affected) in changes.items():
        _, other = synthesize("talking", seed=11, **{name: value})
        for part in same:
            assert np.array_equal(getattr(truth, part), getattr(other, part)) == (part not in affected), (
                name,
                part,
            )
    # The noise itself is the same whatever else changes, and only its size follows its level.
    silent, _ = synthesize("talking", seed=11, noise=0.0)
    loud, _ = synthesize("talking", seed=11, noise=0.6)
    np.testing.assert_allclose(loud.points - silent.points, 2 * (take.points - silent.points), atol=1e-9)
    gappy, gaps = synthesize("talking", seed=11, gaps=0.2)
    assert np.array_equal(gappy.points[gaps.visible], take.points[gaps.visible])
    # One axis of the motion does not depend on another's range; one expression not on another.
    _, nod = synthesize("talking", seed=11, range_deg=(20, 0, 0))
    both = [angles_by_hand(rotation)[0] for rotation in truth.rotations]
    np.testing.assert_allclose([angles_by_hand(r)[0] for r in nod.rotations], both, atol=1e-9)
    _, blink = synthesize("talking", seed=11, actions=("blink",))
    _, more = synthesize("talking", seed=11, actions=("jaw_open", "blink"))
    lid = truth.labels.index("LidL")
    np.testing.assert_array_equal(blink.expression[:, lid], more.expression[:, lid])


def test_same_seed_same_bits_other_seed_other_take():
    first, truth = synthesize("worst-day", seed=12)
    synthesize("talking", seed=99)
    second, again = synthesize("worst-day", seed=12)
    assert first.points.tobytes() == second.points.tobytes()
    assert truth.expression.tobytes() == again.expression.tobytes()
    other, _ = synthesize("worst-day", seed=13)
    assert np.nanmax(np.abs(first.points - other.points)) > 10


DIGESTS = """
import hashlib, sys
from concurrent.futures import ThreadPoolExecutor
from evalkit.synthetic import synthesize

def digest(preset):
    take, truth = synthesize(preset, seed=1, frames=800, noise_time_s=0.1, noise_shared=0.3)
    parts = (take.points, truth.rotations, truth.sway, truth.expression, truth.identity, truth.outliers)
    return preset, hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()

presets = ["outliers", "label-swaps", "two-joints", "worst-day"]
workers, backwards = int(sys.argv[1]), sys.argv[2] == "backwards"
with ThreadPoolExecutor(workers) as pool:
    results = list(pool.map(digest, presets[::-1] if backwards else presets))
print(sorted(results))
"""
"""Digests of some takes; arguments are the number of workers and the order."""


def test_same_bits_in_any_process_order_and_number_of_threads():
    def digests(threads, workers, order):
        limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(threads))
        command = [sys.executable, "-c", DIGESTS, str(workers), order]
        return subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **limits}).stdout

    alone = digests(1, 1, "forwards")
    assert len(set(re.findall("[0-9a-f]{64}", alone))) == 4  # control: different takes have different digests
    assert digests(3, 3, "backwards") == alone


# Digests of what a file stores of the points (32-bit), noted when the presets were first made. In 32 bits the last
# digits of another processor's sines vanish.
@pytest.mark.parametrize(
    ("preset", "changes", "digest"),
    [
        ("talking", {}, "8d431b8849cc613d"),
        ("clean", {"seed": 7, "performer": 3}, "00a4aab469b30b47"),
        ("sway", {"seed": 7, "performer": 3}, "dab282bef9b44f7a"),
        ("gaps", {"seed": 1}, "26ef722a273cf180"),
        ("skin", {}, "e08c289f3981479d"),
        ("small-motion", {}, "e173fd909c94fcd4"),
        ("worst-day", {"seed": 7, "performer": 3, "frames": 900}, "22fff456dfbc88cf"),
    ],
)
def test_takes_stay_as_they_were_first_made(preset, changes, digest):
    def of(**options):
        take, _ = synthesize(preset, **options)
        return hashlib.sha256(take.points.astype("<f4").tobytes()).hexdigest()[:16]

    assert of(**changes) == digest
    assert of(**{**changes, "seed": 8}) != digest  # control


def test_seed_streams_are_named_by_their_text():
    assert (
        seed_sequence("a", "bc", seed=1).generate_state(4).tolist()
        != seed_sequence("ab", "c", seed=1).generate_state(4).tolist()
    )
    assert generator("noise", 0.3, seed=1).random() == generator("noise", "0.3", seed=1).random()
    assert generator("noise", seed=1).random() != generator("noise", seed=2).random()
    # A fixed value: the streams must never change between versions, or stored takes lose their seed.
    assert seed_sequence("motion", "nod", seed=0).generate_state(1)[0] == 2022102244
    for bad in (-1, 1.5, True, "0", 2**70):
        with pytest.raises(EvalkitError, match="seed"):
            seed_sequence("x", seed=bad)


@pytest.mark.parametrize(
    ("preset", "overrides", "text"),
    [
        ("talkin", {}, "did you mean 'talking'"),
        ("single_axis", {}, "did you mean 'single-axis'"),
        ("zzz", {}, "known are talking, "),
        ("talking", {"nois": 1}, "did you mean 'noise'"),
        ("talking", {"gap-length": 3}, "did you mean 'gap_length'"),
        ("talking", {"noise": -1}, "noise = -1 is not a number from 0 to 100"),
        ("talking", {"noise": "loud"}, "noise = 'loud' is not a number"),
        ("talking", {"noise": float("nan")}, "noise = nan is not a number"),
        ("talking", {"noise": True}, "noise = True"),
        ("talking", {"noise": None}, "noise = None"),
        ("talking", {"frames": 0}, "frames = 0 is not a whole number from 1"),
        ("talking", {"frames": 10.5}, "frames = 10.5 is not a whole number"),
        ("talking", {"frames": 10**12}, "frames"),
        ("talking", {"rate": 0}, "rate = 0"),
        ("talking", {"range_deg": (1, 2)}, "range_deg has 2 angles"),
        ("talking", {"range_deg": (1, 2, "x")}, "range_deg = 'x'"),
        ("talking", {"range_deg": None}, "range_deg = None"),
        ("talking", {"range_deg": 120}, "range_deg = 120"),
        ("talking", {"gaps": 1.0}, "gaps = 1.0"),
        ("talking", {"actions": ("smlie",)}, "did you mean 'smile'"),
        ("talking", {"actions": 3}, "actions"),
        ("talking", {"layout": "papr"}, "layout 'papr'"),
        ("talking", {"layout": ["paper-23"]}, "layout"),
        ("talking", {"seed": -1}, "seed -1"),
        ("talking", {"seed": 0.5}, "seed 0.5"),
        (None, {}, "preset 'None' is not known"),
        (["talking"], {}, "preset"),
    ],
)
def test_mistakes_are_one_clear_line(preset, overrides, text):
    with pytest.raises(EvalkitError) as caught:
        synthesize(preset, **overrides)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_numpy_numbers_and_own_parameters_are_welcome():
    take, truth = synthesize("talking", seed=np.int64(3), frames=np.int32(50), noise=np.float32(0.5))
    assert take.frames == 50
    json.dumps(truth.parameters)
    again, custom = synthesize(Parameters(frames=50, noise=0.5), seed=3)
    assert custom.preset == "custom"
    assert again.points.tobytes() == take.points.tobytes()


def test_settings_of_a_command_line():
    assert parse_overrides(["noise=0.5", "frames = 100", "range_deg=5", "layout=paper-23"]) == {
        "noise": 0.5,
        "frames": 100,
        "range_deg": 5.0,
        "layout": "paper-23",
    }
    assert parse_overrides(["range_deg=1,2,3", "actions=speech, blink"]) == {
        "range_deg": (1.0, 2.0, 3.0),
        "actions": ("speech", "blink"),
    }
    for bad, text in [
        ("noise", "name=value"),
        ("nose=1", "did you mean 'noise'"),
        ("frames=1.5", "whole number"),
    ]:
        with pytest.raises(EvalkitError, match=text):
            parse_overrides([bad])


def test_truth_round_trip(tmp_path):
    _, truth = synthesize("worst-day", seed=14)
    truth.save(tmp_path / "truth.npz")
    again = Truth.load(tmp_path / "truth.npz")
    for name in Truth.__dataclass_fields__:
        here, there = getattr(truth, name), getattr(again, name)
        assert np.array_equal(here, there) if isinstance(here, np.ndarray) else here == there, name
    first = (tmp_path / "truth.npz").read_bytes()
    again.save(tmp_path / "copy.npz")
    assert (tmp_path / "copy.npz").read_bytes() == first


def test_bad_truth_files_are_one_line(tmp_path):
    path = tmp_path / "truth.npz"
    with pytest.raises(EvalkitError, match="cannot read"):
        Truth.load(path)
    path.write_bytes(b"not an archive")
    with pytest.raises(EvalkitError, match="not a truth file"):
        Truth.load(path)
    np.savez(path, rotations=np.eye(3))
    with pytest.raises(EvalkitError, match="lacks facts"):
        Truth.load(path)
    _, truth = synthesize("clean", frames=20)
    truth.save(path)
    whole = path.read_bytes()
    random = np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(whole)
        for _ in range(random.integers(1, 4)):
            damaged[random.integers(len(damaged))] = random.integers(256)
        path.write_bytes(bytes(damaged[: random.integers(1, len(damaged))] if random.random() < 0.3 else damaged))
        try:
            Truth.load(path)
        except EvalkitError as error:
            assert "\n" not in str(error)
    for name, value, text in [
        ("rotations", truth.rotations * 1.1, "orthogonal"),
        ("pivot", truth.pivot + 1, "translations"),
        ("sway", truth.sway[:5], "sway has shape"),
        ("expression", truth.expression * np.nan, "not finite"),
        ("visible", truth.visible.astype(float), "visible is of type"),
        ("outliers", truth.outliers[:, :5], "outliers has shape"),
        ("identity", truth.identity + 1, "identity names markers that are not there"),
    ]:
        parts = {field: getattr(truth, field) for field in Truth.__dataclass_fields__}
        Truth(**{**parts, name: value}).save(path)
        with pytest.raises(EvalkitError, match=text):
            Truth.load(path)


def test_truth_of_format_1_is_a_take_without_the_later_faults(tmp_path):
    _, truth = synthesize("two-joints", frames=30, outliers=0.1, swaps=0.1)
    truth.save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as archive:
        parts = dict(archive)
    facts = json.loads(str(parts.pop("facts")))

    def saved(number, without):
        kept = {name: part for name, part in parts.items() if name not in without}
        np.savez_compressed(tmp_path / "old.npz", facts=json.dumps({**facts, "format": number}), **kept)
        return tmp_path / "old.npz"

    old = Truth.load(saved(1, without=("outliers", "identity", "nod_centre")))
    assert old.outliers.shape == old.swapped.shape == truth.visible.shape
    assert not old.outliers.any()
    assert not old.swapped.any()
    assert np.array_equal(old.nod_centre, truth.pivot)
    assert np.array_equal(old.sway, truth.sway)
    with pytest.raises(EvalkitError, match="lacks identity"):
        Truth.load(saved(2, without=("identity",)))
    with pytest.raises(EvalkitError, match="format 3; this version reads formats 1 and 2"):
        Truth.load(saved(3, without=()))


def test_written_take_reads_back_and_matches_its_manifest(tmp_path):
    from evalkit.capture import read_capture

    files = write_synthetic("gaps", tmp_path / "out", seed=15, frames=90, noise=0.4)
    assert [path.name for path in files] == ["gaps.c3d", "gaps.truth.npz", "gaps.json"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(path.name for path in files)
    manifest = json.loads(files.manifest.read_text())
    assert manifest["seed"] == 15
    assert manifest["parameters"]["noise"] == 0.4
    for path in files[:2]:
        assert manifest["sha256"][path.name] == hashlib.sha256(path.read_bytes()).hexdigest()
    take, truth = synthesize("gaps", seed=15, frames=90, noise=0.4)
    read = read_capture(files.capture)
    assert read.labels == take.labels
    assert read.rate == take.rate
    assert np.array_equal(read.visible, take.visible)
    np.testing.assert_allclose(read.points, take.points, atol=1e-4)
    assert np.array_equal(Truth.load(files.truth).expression, truth.expression)
    # The manifest alone is enough to make the files again, bit by bit.
    again = write_synthetic(manifest["preset"], tmp_path / "again", seed=manifest["seed"], **manifest["parameters"])
    assert json.loads(again.manifest.read_text())["sha256"] == manifest["sha256"]


def test_directory_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(EvalkitError, match="cannot write"):
        write_synthetic("clean", tmp_path / "file" / "out", frames=10)


def test_every_preset_is_described():
    for name, preset in PRESETS.items():
        assert name == name.lower()
        assert preset.text
        assert len(preset.text) < 100
