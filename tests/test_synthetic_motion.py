"""How synthetic heads are built and move: layouts, speed profiles, a neck of two joints, one-sided faces."""

import dataclasses
import itertools

import numpy as np
import pytest

from evalkit.metrics import absolute_rotation_error_deg
from evalkit.pivot.algebraic import svd as fixed_pivot
from evalkit.pose import svd
from evalkit.synthetic import PRESETS, Parameters, parse_overrides, synthesize
from evalkit.synthetic.layouts import LAYOUTS
from evalkit.synthetic.motion import PROFILES, head_angles
from evalkit.synthetic.parameters import FIELDS

RATE = 60.0


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts_are_symmetric_faces_with_rigid_markers_off_one_line(name):
    layout = LAYOUTS[name]
    for label, site in layout.sites.items():
        if label.endswith("L"):
            assert layout.sites[f"{label[:-1]}R"] == (-site[0], site[1], site[2])
        elif not label.endswith("R"):
            assert site[0] == 0
    sites = np.array(list(layout.sites.values()))
    distances = np.sqrt(((sites[:, None] - sites) ** 2).sum(axis=2))
    # Markers of 3 to 4 mm need some room to be told apart; the densest face layouts have them 8 mm apart.
    assert distances[np.triu_indices(len(sites), 1)].min() > 7.5
    # A face, not a head: 190 mm is from the hairline to the chin.
    assert 150 < distances.max() < 190
    rigid = np.array([layout.sites[label] for label in layout.rigid])
    spread = np.linalg.svd(rigid - rigid.mean(axis=0), compute_uv=False)
    assert spread[1] > 20


def test_the_dense_layout_covers_the_face():
    sites = np.array(list(LAYOUTS["dense-63"].sites.values()))
    assert len(sites) >= 60
    assert len(LAYOUTS["dense-63"].rigid) == 7
    # Control: the paper's 23 leave places without a marker near them.
    largest_gap = []
    for name in ("dense-63", "paper-23"):
        few = np.array(list(LAYOUTS[name].sites.values()))
        largest_gap.append(np.sqrt(((sites[:, None] - few) ** 2).sum(axis=2)).min(axis=1).max())
    assert largest_gap[0] == 0 < 30 < largest_gap[1]


def test_the_dense_layout_is_a_face_from_top_to_bottom_and_from_front_to_back():
    sites = LAYOUTS["dense-63"].sites

    def heights(*starts):
        return [site[1] for label, site in sites.items() if label.startswith(starts)]

    regions = [("Forehead",), ("Brow", "Temple"), ("Lid", "Eye"), ("CheekU", "CheekO", "CheekI"), ("UpperLip",)]
    regions += [("LowerLip",), ("Chin",)]
    for upper, lower in itertools.pairwise(regions):
        assert min(heights(*upper)) > max(heights(*lower)), (upper, lower)
    # A face bulges forward: off the nose, depth is a quadratic function of width and height within a centimetre.
    points = np.array([site for label, site in sites.items() if not label.startswith("Nose")])
    x, y, z = points.T
    columns = np.column_stack([np.ones_like(x), y, y**2, x**2, x**2 * y])
    fitted, *_ = np.linalg.lstsq(columns, z, rcond=None)
    assert np.abs(columns @ fitted - z).max() < 10.0  # the lower lids, in the sockets, are deepest by 7 mm
    assert fitted[3] < 0
    assert sites["NoseTip"][2] == max(site[2] for site in sites.values())


def test_markers_of_the_dense_layout_never_run_into_each_other():
    nearest = []
    for seed in range(3):
        _, truth = synthesize("dense", seed=seed, performer=seed)
        square = ((truth.clean[::5, :, None] - truth.clean[::5, None]) ** 2).sum(axis=3)
        nearest.append(np.sqrt(square[:, *np.triu_indices(63, 1)].min()))
    assert min(nearest) > 3.0  # the diameter of a marker


@pytest.mark.parametrize("layout", LAYOUTS)
def test_rigid_markers_of_every_layout_are_rigid_until_skin_slides(layout):
    _, still = synthesize("clean", layout=layout, frames=200)
    assert still.rigid == LAYOUTS[layout].rigid
    assert still.rigid_slide_mm == 0.0
    _, sliding = synthesize("clean", layout=layout, frames=200, skin=4.0)
    size = np.sqrt((sliding.expression**2).sum(axis=2)).max(axis=0)
    assert size[sliding.labels.index("ForeheadL")] > 1.0
    if "NoseBridge" in sliding.rigid:  # skin of the nose holds to the bone
        assert size[sliding.labels.index("NoseBridge")] == 0.0


def angular_speed(profile, seed, axis=1, length_s=60.0, speed=100.0):
    """Speed about one axis, deg/s, of a range of 15 deg."""
    angles = head_angles(np.arange(int(length_s * RATE)) / RATE, (15, 15, 15), speed, seed, profile)
    return np.diff(angles[:, axis]) * RATE


def test_held_postures_are_held():
    def changes_per_minute(profile):
        moving = [np.abs(angular_speed(profile, seed)) > 5.0 for seed in range(4)]
        return np.mean([(m[1:] & ~m[:-1]).sum() for m in moving])

    # A hold of 3 s on average, and a change of about one.
    assert 10 < changes_per_minute("held") < 20
    assert changes_per_minute("talk") > 40  # control


def test_shaking_repeats_fast():
    def fast_share(profile):
        shares = []
        for seed in range(4):
            speed = angular_speed(profile, seed, speed=300.0)
            power = np.abs(np.fft.rfft(speed * np.hanning(len(speed)))) ** 2
            frequency = np.fft.rfftfreq(len(speed), 1 / RATE)
            shares.append(power[(frequency > 1.0) & (frequency < 3.0)].sum() / power.sum())
        return np.mean(shares)

    # Bursts of 1.2 to 2.4 Hz make nearly all of the speed; a posture now and then is the rest.
    assert fast_share("shaking") > 0.9
    assert fast_share("talk") < 0.7  # control


def test_reading_is_slow_one_way_and_fast_back():
    def ratio(profile):
        values = []
        for seed in range(4):
            speed = angular_speed(profile, seed)
            one, other = np.percentile(speed, 99), -np.percentile(speed, 1)
            values.append(max(one, other) / min(one, other))
        return np.mean(values)

    # The paces are 0.15 to 0.25 one way and 0.6 to 1 back: between 2.4 and 6.7, 4 in the middle.
    assert 2.4 < ratio("reading") < 6.7
    assert ratio("talk") < 1.8  # control


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("frames", [1, 2, 60, 4000])
def test_every_profile_reaches_the_range_and_leaves_still_axes_still(profile, frames):
    angles = head_angles(np.arange(frames) / RATE, (7, 3, 0), 100.0, 5, profile)
    np.testing.assert_allclose(np.abs(angles).max(axis=0), (7, 3, 0), atol=1e-12)


def turn_about(centre, axis, degrees, point):
    """A point turned about one axis through a centre, by Rodrigues' formula."""
    k, v = np.eye(3)["xyz".index(axis)], point - centre
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return centre + v * c + np.cross(k, v) * s + k * (k @ v) * (1 - c)


@pytest.mark.parametrize("gap", [50.0, -30.0])
def test_neck_of_two_joints_is_the_composition_of_its_hinges(gap):
    take, truth = synthesize("two-joints", seed=3, noise=0.0, frames=40, neck_gap_mm=gap, sway=5.0)
    _, one = synthesize("two-joints", seed=3, noise=0.0, frames=40, neck_gap_mm=0.0, sway=5.0)
    times = np.arange(40) / RATE
    angles = head_angles(times, truth.parameters["range_deg"], truth.parameters["speed"], 3)
    np.testing.assert_allclose(truth.nod_centre - truth.pivot, (0, gap, 0), atol=1e-12)
    for i in range(40):
        nod, turn, tilt = angles[i]
        for m in range(len(truth.labels)):
            point = truth.clean[i, m]
            point = turn_about(truth.pivot, "z", tilt, point)
            point = turn_about(truth.nod_centre, "x", nod, point)
            point = turn_about(truth.pivot, "y", turn, point) + one.sway[i]
            # 2 m, some ten operations: 1e-12 m.
            np.testing.assert_allclose(take.points[i, m], point, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(truth.rotations, one.rotations)
    eye = np.eye(3)
    np.testing.assert_allclose(truth.translations, (eye - truth.rotations) @ truth.pivot + truth.sway, atol=1e-9)
    assert np.abs(truth.sway - one.sway).max() > 5.0  # control: the second joint matters


def test_two_joints_pose_is_exact_and_one_pivot_is_not_unless_the_head_only_nods():
    def residual_mm(**changes):
        take, truth = synthesize("two-joints", seed=1, noise=0.0, frames=300, **changes)
        rigid = [truth.labels.index(label) for label in truth.rigid]
        pose = svd(truth.neutral[rigid], take.points[:, rigid])
        # The pose of every frame does not care how many joints there are.
        assert (
            absolute_rotation_error_deg(pose.rotations, truth.rotations).max() < 1e-5
        )  # arccos near 1: sqrt(2 eps) rad
        pivot = fixed_pivot(take.points[:, rigid], pose).position
        path = np.einsum("fij,j->fi", pose.rotations, pivot) + pose.translations
        return pivot - truth.nod_centre, np.sqrt(((path - pivot) ** 2).sum(axis=1).mean())

    assert residual_mm()[1] > 1.0
    assert residual_mm(neck_gap_mm=0.0)[1] < 1e-6
    offset, left = residual_mm(range_deg=(20.0, 0.0, 0.0))
    assert left < 1e-6  # nods alone have one centre: that of the nod; x along its axis is free
    assert np.abs(offset[1:]).max() < 1e-6


def test_asymmetry_stills_one_side_and_mirrors():
    def motion(asymmetry, **changes):
        _, truth = synthesize("clean", seed=2, actions=("smile", "brow_raise"), asymmetry=asymmetry, **changes)
        return dict(zip(truth.labels, truth.expression.transpose(1, 0, 2), strict=True))

    both, left, right = motion(0.0), motion(1.0), motion(-1.0)
    mirror = np.array([-1.0, 1.0, 1.0])
    for name in ("Mouth", "BrowOut", "Cheek"):
        # The blend between the sides ends 15 mm from the middle: these are beyond it.
        np.testing.assert_array_equal(left[f"{name}L"], both[f"{name}L"])
        assert np.abs(both[f"{name}R"]).max() > 1.0
        np.testing.assert_allclose(left[f"{name}L"], right[f"{name}R"] * mirror, atol=1e-12)
    # What is left on the right is the lids' own part of smile and brow raise, which stays two-sided.
    assert np.abs(left["MouthR"]).max() < 0.05 < np.abs(both["MouthR"]).max()
    assert np.abs(left["BrowOutR"]).max() < 0.25 * np.abs(both["BrowOutR"]).max()
    sliding = motion(1.0, skin=4.0)
    assert np.abs(sliding["ForeheadR"]).max() == 0.0
    assert np.abs(sliding["ForeheadL"]).max() > 1.0


def test_every_parameter_is_described_where_users_look():
    names = [field.name for field in dataclasses.fields(Parameters)]
    assert sorted(FIELDS) == sorted(names)
    for name in names:
        assert f"\n    {name} : " in Parameters.__doc__
    groups = [field.group for field in FIELDS.values()]
    assert len(set(groups)) == 1 + sum(a != b for a, b in itertools.pairwise(groups))  # each in one piece


@pytest.mark.parametrize("name", PRESETS)
def test_settings_of_a_preset_read_back_as_the_preset(name):
    parameters = PRESETS[name].parameters
    assert Parameters().replaced(parse_overrides(parameters.settings().split())) == parameters
