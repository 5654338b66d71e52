"""The deformation map: centres, regions, seams, static points, surface distances, and what is said of bad input."""

from __future__ import annotations

import dataclasses
from importlib.util import find_spec

import numpy as np
import pytest
from contracts.faces import HALF_WIDTH, MOUTH, face
from realdata import real_data

from evalkit import EvalkitError, deformation_map, kernels
from evalkit.deform import deformation_report, fill_missing, seam_jump, seam_treatments
from evalkit.deform.regions import LIP_SITES
from evalkit.deform.surface import edge_distance, edge_graph, heat_distances, spread_out
from evalkit.dense import skin_of_ict

HEAD = face()
NAMES = list(HEAD.marker_sites)
SITES = np.array(list(HEAD.marker_sites.values()))
needs_potpourri3d = pytest.mark.skipif(find_spec("potpourri3d") is None, reason="evalkit[surface] is not installed")


def speech():
    """Displacements (3, n, 3), mm: jaw opened by 10 mm, left corner smiling by 8 mm, lips pursed by 5 mm."""
    moves = np.zeros((3, len(NAMES), 3))
    for name, share in {"Chin": 1.0, "LowerLipC": 0.9, "LowerLipL": 0.8, "LowerLipR": 0.8}.items():
        moves[0, NAMES.index(name)] = share * np.array([0.0, -10.0, -3.0])
    for name in ("MouthL", "MouthR"):
        moves[0, NAMES.index(name)] = [0.0, -4.0, -1.0]
    moves[1, NAMES.index("MouthL")] = [6.0, 5.0, -2.0]
    moves[1, NAMES.index("CheekL")] = [1.0, 3.0, 1.0]
    for name in ("MouthL", "MouthR", "UpperLipL", "UpperLipR", "LowerLipL", "LowerLipR"):
        moves[2, NAMES.index(name), 0] = -0.2 * HEAD.marker_sites[name][0]
        moves[2, NAMES.index(name), 2] = 4.0
    return moves


# Centres


def test_names_positions_mappings_and_vertices_say_the_same():
    at = np.array([int(np.argmin(np.linalg.norm(HEAD.vertices - place, axis=1))) for place in SITES])
    expected = deformation_map(HEAD, NAMES)
    for centres in (SITES, HEAD.marker_sites, dict(zip("abcdefghijklmnopqrstuvw", SITES, strict=True)), at):
        np.testing.assert_array_equal(deformation_map(HEAD, centres), expected)


def test_a_head_may_give_its_sites_as_vertices():
    at = {
        name: int(np.argmin(np.linalg.norm(HEAD.vertices - place, axis=1))) for name, place in HEAD.marker_sites.items()
    }
    np.testing.assert_array_equal(
        deformation_map(dataclasses.replace(HEAD, marker_sites=at), NAMES), deformation_map(HEAD, NAMES)
    )


def test_centres_that_are_no_sites_play_the_part_of_the_nearest():
    """A lip marker 3 mm off its site still belongs to its lip; one on the neck to none."""
    moved = {f"m{i}": place + np.array([1.5, 1.5, 0.0]) for i, place in enumerate(SITES)} | {
        "below": np.array([0.0, -125.0, 85.0])
    }
    fields = {field.region: field.centres for field in deformation_report(HEAD, moved).fields}
    for lip, sites in LIP_SITES.items():
        assert set(fields[lip]) == {f"m{NAMES.index(name)}" for name in sites}


def wrong(call, *words):
    """The one line of an error, which has all these words in it."""
    with pytest.raises(EvalkitError) as caught:
        call()
    line = str(caught.value)
    assert "\n" not in line
    for word in words:
        assert word in line
    return line


def with_nan():
    sites = dict(HEAD.marker_sites)
    sites["CheekL"] = np.array([np.nan, 0.0, 90.0])
    return sites


WITHOUT_LIPS = dataclasses.replace(HEAD, regions={k: v for k, v in HEAD.regions.items() if "lip" not in k})
BLIND = dataclasses.replace(HEAD, marker_sites={k: v for k, v in HEAD.marker_sites.items() if k != "LidL"})


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: deformation_map(HEAD, ["Chinn", "CheekL"]), ["Chinn", "did you mean Chin?"]),
        (lambda: deformation_map(HEAD, ["zzz"]), ["zzz", "the head has ForeheadC"]),
        (lambda: deformation_map(HEAD, NAMES, "expnential"), ["expnential", "did you mean exponential"]),
        (lambda: deformation_map(HEAD, NAMES, "??"), ["known are exponential"]),
        (lambda: deformation_map(HEAD, []), ["no centres"]),
        (lambda: deformation_map(HEAD, 7), ["7", "expected names"]),
        (lambda: deformation_map(HEAD, np.zeros((4, 2))), ["neither a position of three numbers"]),
        (lambda: deformation_map(HEAD, [10**6]), ["1000000", "not one of the head's"]),
        (lambda: deformation_map(HEAD, with_nan()), ["CheekL", "no finite position"]),
        (lambda: deformation_map(HEAD, SITES / 1000), ["its unit"]),
        (lambda: deformation_map(HEAD, ["Chin", "Chin"]), ["Chin and Chin", "same place"]),
        (lambda: deformation_map(HEAD, NAMES, scale_mm=-1.0), ["scale_mm is -1", "positive"]),
        (lambda: deformation_map(HEAD, NAMES, "cubic", scale_mm=10.0), ["scale_mm has no meaning"]),
        (lambda: deformation_map(HEAD, NAMES, seam="soft"), ["soft", "known are none, hard, ramp, spline"]),
        (lambda: deformation_map(HEAD, NAMES, regions={"upper lip": ["UpperLipC"]}), ["upper lip and lower lip"]),
        (
            lambda: deformation_map(HEAD, NAMES, regions={"upper lip": ["UpperLipC"], "lower lip": ["Tongue"]}),
            ["Tongue", "not among the 23 centres"],
        ),
        (lambda: deformation_map(WITHOUT_LIPS, NAMES), ["no region 'upper lip'", "regions=False"]),
        (lambda: deformation_map(BLIND, ["Chin"]), ["LidL", "inter-eye distance"]),
        (lambda: fill_missing(HEAD, NAMES, np.zeros((5, 22, 3))), ["(5, 22, 3)", "expected (frames, 23, 3)"]),
    ],
)  # fmt: skip
def test_a_mistake_gets_one_line(call, words):
    wrong(call, *words)


# Regions and static points


def test_each_lip_listens_to_its_own_markers_alone():
    """Away from the corners the lower lip's markers have no part in the upper lip, and the other way round."""
    corners = np.array([HEAD.marker_sites["MouthL"], HEAD.marker_sites["MouthR"]])
    one, many = deformation_map(HEAD, NAMES, regions=False), deformation_map(HEAD, NAMES)
    for lip, sites in LIP_SITES.items():
        middle = HEAD.regions[lip]
        away = np.linalg.norm(HEAD.vertices[middle][:, None] - corners, axis=2).min(axis=1) > 15.0
        others = [i for i, name in enumerate(NAMES) if name not in sites]
        np.testing.assert_array_equal(many[np.ix_(middle[away], others)], 0.0)
        # Control: in one field of force they have.
        assert np.abs(one[np.ix_(middle[away], others)]).max() > 0.1


def test_regions_may_be_given_as_centres():
    chosen = {lip: list(sites) for lip, sites in LIP_SITES.items()}
    np.testing.assert_array_equal(deformation_map(HEAD, NAMES, regions=chosen), deformation_map(HEAD, NAMES))
    by_index = {lip: [NAMES.index(name) for name in sites] for lip, sites in LIP_SITES.items()}
    np.testing.assert_array_equal(deformation_map(HEAD, NAMES, regions=by_index), deformation_map(HEAD, NAMES))


def test_a_lip_without_markers_moves_with_the_face():
    """Upper faces and reduced layouts work too, and the report says what was done."""
    few = ["ForeheadC", "BrowInL", "LidL", "NoseBridge", "CheekR", "Chin"]
    report = deformation_report(HEAD, few[:4])
    assert len(report.notes) == 2 and "lower lip: none of its markers" in report.notes[1]
    np.testing.assert_array_equal(report.weights, deformation_map(HEAD, few[:4], regions=False))
    fields = {field.region: field.centres for field in deformation_report(HEAD, few).fields}
    assert fields["upper lip"] == ("CheekR",) and fields["lower lip"] == ("Chin",)


def test_static_points_hold_the_rim():
    rim = HEAD.regions["hindbrain"]
    drift = {
        static: np.abs(deformation_map(HEAD, NAMES, static=static)[rim] @ speech()[0]).max() for static in (False, True)
    }
    # A 10 mm motion of the jaw; halfway between two static points, some 90 mm apart, a little of it is left.
    assert drift[True] < 1.0
    # Control: nothing holds it.
    assert drift[False] > 5.0


def test_static_points_may_be_given():
    report = deformation_report(HEAD, NAMES, static=["ForeheadC"], regions=False)
    assert report.static.shape == (0, 3)  # a marker that moves is not static
    report = deformation_report(HEAD, NAMES[1:], static=["ForeheadC"], regions=False)
    at = np.argmin(np.linalg.norm(HEAD.vertices - HEAD.marker_sites["ForeheadC"], axis=1))
    np.testing.assert_allclose(report.weights[at], 0.0, atol=1e-9)  # rounding of a well conditioned solve


def test_static_points_are_spread_and_do_not_hang_on_rounding():
    points = HEAD.vertices[HEAD.regions["hindbrain"]]
    chosen = spread_out(points, 12)
    gaps = np.linalg.norm(points[chosen][:, None] - points[chosen], axis=2) + 1e9 * np.eye(12)
    assert gaps.min() > 20.0  # twelve points on a rim of about 500 mm
    np.testing.assert_array_equal(spread_out(points * (1 + 1e-15), 12), chosen)


def test_parts_outside_the_regions_stay_still():
    """Teeth and eyeballs are no part of the soft face: their rows are zero, and they change nothing else."""
    ball = np.array([[30.0, 45.0, 80.0], [35.0, 45.0, 80.0], [32.0, 50.0, 80.0]])
    more = dataclasses.replace(
        HEAD,
        vertices=np.vstack([HEAD.vertices, ball]),
        triangles=np.vstack([HEAD.triangles, len(HEAD.vertices) + np.arange(3)]),
    )
    for kernel in ("exponential", "bilaplacian"):
        weights = deformation_map(more, NAMES, kernel)
        np.testing.assert_array_equal(weights[-3:], 0.0)
        np.testing.assert_allclose(weights[:-3], deformation_map(HEAD, NAMES, kernel), atol=1e-12)


def test_the_report_tells_what_was_built():
    report = deformation_report(HEAD, NAMES)
    assert [field.region for field in report.fields] == ["face", "upper lip", "lower lip"]
    assert report.static.shape == (20, 3) and report.fields[0].static == 20
    assert report.scale_mm == pytest.approx(report.inter_eye_mm) and report.seam == "ramp" and report.notes == ()
    assert all(1.0 <= field.condition < 1e3 and field.truncated == 0 for field in report.fields)
    bare = dataclasses.replace(HEAD, regions={"face": HEAD.regions["face"]})
    assert "nothing holds its back still" in deformation_report(bare, NAMES, regions=False).notes[0]
    wide = deformation_report(HEAD, NAMES, "gaussian", scale_mm=5000.0, regions=False)
    assert wide.fields[0].truncated > 0 and any("scale too large" in note for note in wide.notes)


# Seams


def largest_jump(head, names, moves, seam):
    weights = deformation_map(head, names, seam=seam)
    return float(seam_jump(head, np.einsum("vn,fnc->fvc", weights, moves)).max())


def test_jump_beside_the_corners():
    jump = {seam: largest_jump(HEAD, NAMES, speech(), seam) for seam in seam_treatments}
    # The aim: a twentieth of a millimetre, where motions are 4 to 10 mm.
    assert jump["ramp"] < 0.05
    assert jump["none"] < 0.05
    # Control: the same measure sees hard membership.
    assert jump["hard"] > 0.2


def test_seam_jump_sees_a_step_and_not_a_slope():
    slope = HEAD.vertices * [0.0, 0.03, 0.0]
    # Edges of other directions see a little less of a slope along the curved skin.
    assert seam_jump(HEAD, slope[None]).max() < 0.001
    step = slope.copy()
    step[HEAD.regions["upper lip"], 2] += 0.5
    assert seam_jump(HEAD, step[None]).max() > 0.3


def test_ramp_is_a_mean_of_the_fields():
    """No weight outside what the three fields say, and one field's value where nothing is blended."""
    low = np.full((len(HEAD.vertices), 1), 1.0)
    fields = {"face": low, "upper lip": 2 * low, "lower lip": 4 * low}
    from evalkit.deform.regions import Seams, ramp

    member = {lip: np.isin(np.arange(len(low)), HEAD.regions[lip]) for lip in LIP_SITES}
    seams = Seams(HEAD.vertices, edge_graph(HEAD.vertices, HEAD.triangles), member, 10.0)
    blended = ramp(fields, seams)[:, 0]
    assert blended.min() >= 1.0 and blended.max() <= 4.0
    np.testing.assert_allclose(blended[seams.corners() & (member["upper lip"] | member["lower lip"])], 3.0)
    assert blended[np.argmin(np.linalg.norm(HEAD.vertices - HEAD.marker_sites["LowerLipC"], axis=1))] == 4.0
    assert (blended[HEAD.regions["hindbrain"]] == 1.0).all()


def test_the_edges_of_the_lips_follow_their_own_markers():
    """The jaw opens by 25 mm and takes the corners along by a third, as a performer's does; the upper lip stays."""
    from evalkit.head import load_head

    head = load_head("template")
    names = list(head.marker_sites)
    move = np.zeros((len(names), 3))
    for name in ("LowerLipC", "LowerLipL", "LowerLipR", "Chin"):
        move[names.index(name), 1] = -25.0
    for name in ("MouthL", "MouthR"):
        move[names.index(name), 1] = -8.0
    rim = np.intersect1d(head.part_vertices("skin"), head.part_vertices("mouth pocket"))

    def down(regions):
        """How far the middle of the upper and the lower edge go down, mm."""
        edges = [np.intersect1d(rim, head.regions[lip]) for lip in ("upper lip", "lower lip")]
        middle = [edge[np.abs(head.vertices[edge, 0]).argmin()] for edge in edges]
        upper, lower = -(deformation_map(head, names, regions=regions)[middle] @ move)[:, 1]
        return upper, lower

    upper, lower = down(True)
    # The edges are 11 mm away from the markers and as near to the corners' height as to theirs: some of what the
    # corners do may show, a millimetre above and a seventh of the opening below.
    assert abs(upper) < 1.0 and 0.85 * 25.0 <= lower < 1.05 * 25.0
    # Control: one field for all moves the two edges, at the same place at rest, alike.
    upper, lower = down(False)
    assert upper > 5.0 and lower < 0.7 * 25.0


def test_a_marker_far_from_a_corner_is_not_the_corners():
    """Beside the jaw a corner is the nearest site; the upper lip must not listen to what goes with the jaw."""
    places = {name: np.asarray(HEAD.marker_sites[name]) for name in NAMES if not name.startswith("Mouth")}
    # At the corners to a few millimetres, as a marker of one's own set is, and on the jaw below the left one.
    near = {name: np.add(HEAD.marker_sites[name], [0.0, -4.0, 0.0]) for name in ("MouthL", "MouthR")}
    jaw = {"jaw": np.add(HEAD.marker_sites["MouthL"], [6.0, -18.0, -6.0])}
    own = {f"my {name}": place for name, place in near.items()}
    upper, lower = deformation_report(HEAD, places | own | jaw).fields[1:]
    assert set(own) <= set(upper.centres) and set(own) <= set(lower.centres)
    assert "jaw" not in upper.centres and "jaw" in lower.centres


# Distances along the surface


def sides_of_the_slit():
    """The two vertices at the middle of the mouth, upper and lower."""
    middle = np.flatnonzero((np.abs(HEAD.vertices[:, 0]) < 1e-9) & (np.abs(HEAD.vertices[:, 1] - MOUTH) < 0.3))
    assert len(middle) == 2
    return middle


def test_the_way_from_lip_to_lip_is_round_the_corner():
    a, b = sides_of_the_slit()
    assert np.linalg.norm(HEAD.vertices[a] - HEAD.vertices[b]) < 0.3  # straight across
    along = edge_distance(edge_graph(HEAD.vertices, HEAD.triangles), [a])[b]
    assert along > 2 * (HALF_WIDTH - 3.0)


@needs_potpourri3d
def test_heat_distances():
    """On a plane they are the straight ones; across the slit they go round the corner."""
    n = 41
    grid = np.stack([*np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), np.zeros((n, n))], axis=-1)
    index = np.arange(n * n).reshape(n, n)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    triangles = np.vstack([quads[:, :3], quads[:, [0, 2, 3]]])
    plane = grid.reshape(-1, 3).astype(float)
    source = index[20, 20]
    error = heat_distances(plane, triangles, np.array([source]))[0] - np.linalg.norm(plane - plane[source], axis=1)
    # The method's own error at its default time step: some tenths of an edge, more at the border.
    assert np.abs(error).max() < 1.5 and np.sqrt((error**2).mean()) < 0.5
    a, b = sides_of_the_slit()
    across = heat_distances(HEAD.vertices, HEAD.triangles, np.array([a, b]))
    assert across[0, b] == across[1, a] > 1.6 * (HALF_WIDTH - 3.0)
    assert across[0, a] == 0.0


# A dense truth


def test_real_expressions_lip_regions_and_surface_methods_help():
    """ICT-FaceKit's expressions from the 23 sites: errors in mm that are lower than without motion or regions."""
    head = skin_of_ict(real_data("meshes", "ict_facekit_subset.npz"))
    moves = {name: np.zeros_like(head.vertices) for name in head.blendshapes}
    for name, (which, move) in head.blendshapes.items():
        moves[name][which] = move
    at = [int(np.argmin(np.linalg.norm(head.vertices - place, axis=1))) for place in head.marker_sites.values()]
    # Not the gaze; nor mouthClose, which closes the lips of an open jaw and is no face by itself.
    truth = np.array([move for name, move in moves.items() if not name.startswith(("eyeLook", "Pupil", "mouthClose"))])
    lips = np.concatenate([head.regions[lip] for lip in LIP_SITES])

    def rms(kernel, regions, vertices):
        weights = deformation_map(head, list(head.marker_sites), kernel, regions=regions)[vertices]
        return np.sqrt(((np.einsum("vn,fnc->fvc", weights, truth[:, at]) - truth[:, vertices]) ** 2).sum(-1).mean())

    still = np.sqrt((truth[:, lips] ** 2).sum(-1).mean())
    one, many = rms("exponential", False, lips), rms("exponential", True, lips)
    assert many < 0.9 * one < 0.5 * still
    assert rms("bilaplacian", True, lips) < many
    assert set(kernels) >= {"exponential", "bilaplacian"}


@pytest.mark.slow
def test_the_template_head():
    """The built-in head with its mouth pocket, teeth and eyeballs: every kernel, seams, and a jaw of its own."""
    from evalkit.head import load_head

    head = load_head("template")
    names = list(head.marker_sites)
    at = list(head.nearest_vertices(head.marker_sites).values())
    truth = head.posed(jaw_deg=8.0) - head.vertices
    lips = np.concatenate([head.regions[lip] for lip in LIP_SITES])
    skin = np.intersect1d(lips, head.skin_vertices)

    def rms(weights):
        return np.sqrt(((weights @ truth[at] - truth)[skin] ** 2).sum(axis=1).mean())

    for name in kernels:
        weights = deformation_map(head, names, name)
        assert np.isfinite(weights).all() and weights.shape == (len(head.vertices), len(names))
        # The lips follow the jaw better than if they stayed where they are.
        assert rms(weights) < 0.5 * np.sqrt((truth[skin] ** 2).sum(axis=1).mean()), name
    assert rms(deformation_map(head, names)) < rms(deformation_map(head, names, regions=False))
    assert largest_jump(head, names, speech(), "ramp") < 0.05 < 0.2 < largest_jump(head, names, speech(), "hard")
