"""The scene of a moving head: what is uploaded is what is seen, every time."""

from __future__ import annotations

import ctypes
import gc
import resource
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from small_head import head_to_draw

from evalkit.errors import EvalkitError
from evalkit.geometry import rotation_from_vector
from evalkit.head import Head, load_head
from evalkit.render.head_scene import HeadScene, VertexNormals

SIZE = (160, 160)


@pytest.fixture(scope="module")
def head() -> Head:
    return head_to_draw()


@pytest.fixture(scope="module")
def scene(head: Head) -> Iterator[HeadScene]:
    with HeadScene(head, SIZE) as scene:
        yield scene


def changed(a: np.ndarray, b: np.ndarray) -> int:
    """Pixels that differ."""
    return int((a != b).any(axis=-1).sum())


def moved(head: Head, site: str, by_mm: tuple[float, float, float]) -> np.ndarray:
    """The vertices with the one nearest to a marker site moved."""
    out = head.vertices.copy()
    out[head.nearest_vertices({site: head.marker_sites[site]})[site]] += by_mm
    return out


def test_a_picture_is_an_array_of_its_own_with_its_first_row_on_top(scene: HeadScene, head: Head) -> None:
    first = scene.frame(head.vertices)
    assert first.shape == (160, 160, 3)
    assert first.dtype == np.uint8
    kept = first.copy()
    scene.frame(head.vertices + np.array([0.0, 20.0, 0.0]))
    assert changed(first, kept) == 0
    # The forehead is above the chin: what was raised leaves background below and covers it above.
    raised = scene.frame(head.vertices + np.array([0.0, 20.0, 0.0]))
    background = first[0, 0]
    rows = [np.flatnonzero((picture != background).any(axis=(1, 2))) for picture in (first, raised)]
    assert rows[1][0] < rows[0][0]
    assert rows[1][-1] < rows[0][-1]


def test_one_moved_vertex_changes_the_picture_there_and_nowhere_else(scene: HeadScene, head: Head) -> None:
    rest = scene.frame(head.vertices)
    assert changed(rest, scene.frame(head.vertices)) == 0  # control: the same positions give the same pixels
    other = scene.frame(moved(head, "Chin", (0.0, 0.0, 8.0)))
    assert changed(rest, other) > 0
    rows = np.flatnonzero((rest != other).any(axis=(1, 2)))
    # The chin is in the lower half of the picture; its triangles and their neighbours, whose normals turn, too.
    assert rows[0] > 80


def test_reading_never_gives_the_picture_before(scene: HeadScene, head: Head) -> None:
    """Reading after showing, without rendering, gives the new picture; so does reading after posing."""
    before = scene.frame(head.vertices)
    open_mouth = head.posed(jaw_deg=20.0)
    scene.show(open_mouth)
    unasked = scene.read()
    assert changed(before, unasked) > 0
    assert changed(unasked, scene.frame(open_mouth)) == 0
    scene.pose(rotation_from_vector([0.0, 0.3, 0.0]), [0.0, 0.0, 0.0])
    assert changed(unasked, scene.read()) > 0
    scene.pose(np.eye(3), np.zeros(3))
    assert changed(before, scene.frame(head.vertices)) == 0


def test_the_actor_matrix_moves_the_head_as_moving_every_vertex_does(scene: HeadScene, head: Head) -> None:
    rotation, translation = rotation_from_vector([0.1, 0.25, -0.05]), np.array([3.0, -4.0, 10.0])
    scene.pose(rotation, translation)
    by_matrix = scene.frame(head.vertices)
    scene.pose(np.eye(3), np.zeros(3))
    by_vertices = scene.frame(head.vertices @ rotation.T + translation)
    rest = scene.frame(head.vertices)
    # Positions are rounded to single precision before or after the motion: 1e-5 mm, which moves a few edge pixels.
    assert changed(by_matrix, by_vertices) < 0.01 * changed(by_matrix, rest)


@pytest.mark.parametrize("part", ["skin", "plate", "eyeballs", "ears", "upper teeth"])
def test_a_part_left_out_is_missed(scene: HeadScene, head: Head, part: str) -> None:
    places = head.posed(jaw_deg=25.0)
    with HeadScene(head, SIZE, without=(part,)) as lacking:
        assert changed(scene.frame(places), lacking.frame(places)) > 0


def test_the_camera_stays_where_the_head_at_rest_put_it(scene: HeadScene, head: Head) -> None:
    def camera() -> tuple[object, ...]:
        found = scene._plotter.camera
        return found.position, found.focal_point, found.view_angle, found.clipping_range, found.up

    before = camera()
    rest = scene.frame(head.vertices)
    small = scene.frame(0.5 * head.vertices)
    scene.pose(np.eye(3), [500.0, 0.0, 0.0])
    away = scene.read()
    scene.pose(np.eye(3), np.zeros(3))
    assert camera() == before
    # A camera that fits itself would show the small head as large, and the head that left as if it had not.
    covered = [int((picture != picture[0, 0]).any(axis=-1).sum()) for picture in (rest, small, away)]
    assert 0.2 * covered[0] < covered[1] < 0.3 * covered[0]
    assert covered[2] == 0


def test_views_textures_samples_shading_and_wires_differ(head: Head) -> None:
    options: list[dict[str, object]] = [
        {}, {"view": "three-quarter"}, {"view": "profile"}, {"textured": False}, {"multisamples": 8},
        {"shading": "flat", "textured": False}, {"wireframe": True}, {"background": "black"},
    ]  # fmt: skip
    pictures = []
    for option in options:
        with HeadScene(head, SIZE, **option) as scene:  # type: ignore[arg-type]
            pictures.append(scene.frame(head.vertices))
            assert scene.renderer
    assert len({picture.tobytes() for picture in pictures}) == len(options)


def test_markers_are_drawn_moved_and_left_out_where_missing(head: Head) -> None:
    sites = np.array([head.marker_sites[name] for name in ("Chin", "CheekL")])
    sites += (0.0, 0.0, 5.0)
    with HeadScene(head, SIZE, textured=False, markers=sites) as scene, HeadScene(head, SIZE, textured=False) as bare:
        without = bare.frame(head.vertices)
        both = scene.frame(head.vertices)
        one = scene.frame(head.vertices, np.array([sites[0], [np.nan] * 3]))
        none = scene.frame(head.vertices, np.full((2, 3), np.nan))
        assert changed(without, both) > changed(without, one) > changed(without, none) == 0
        assert changed(one, scene.frame(head.vertices, np.array([sites[0] + [5.0, 0.0, 0.0], [np.nan] * 3]))) > 0
        with pytest.raises(EvalkitError, match="made with 2"):
            scene.show(head.vertices, sites[:1])


def test_bad_arguments_are_one_line(scene: HeadScene, head: Head) -> None:
    for options, words in (
        ({"view": "behind"}, "three-quarter"),
        ({"shading": "toon"}, "smooth, flat"),
        ({"size": (0, 10)}, "0 x 10"),
        ({"without": ("beard",)}, "beard"),
        ({"markers": np.zeros(3)}, r"\(3,\)"),
    ):
        with pytest.raises(EvalkitError, match=words):
            HeadScene(head, **options)  # type: ignore[arg-type]
    with pytest.raises(EvalkitError, match="vertices have shape"):
        scene.show(head.vertices[:-1])


def test_normals_are_the_means_around_a_vertex(head: Head) -> None:
    places = head.vertices.astype(np.float32)
    out = VertexNormals(head.triangles, len(places))(places)
    sums = np.zeros(head.vertices.shape)
    for triangle in head.triangles:
        a, b, c = places[triangle].astype(np.float64)
        sums[triangle] += np.cross(b - a, c - a)
    length = np.linalg.norm(sums, axis=1)
    # A vertex that no triangle uses has no normal.
    clear = length > 1e-2
    assert clear.mean() > 0.98
    # The same positions, ten products and sums each rounded to 6e-8 of the largest term.
    assert np.abs(out[clear] - sums[clear] / length[clear, None]).max() < 2e-6
    assert np.isfinite(out).all()


def resident_kb() -> float:
    """Resident memory of the process; what was given back before goes back to the system first, lest it be refilled."""
    statm, libc = Path("/proc/self/statm"), ctypes.CDLL(None)
    if not (statm.exists() and hasattr(libc, "malloc_trim")):
        pytest.skip("resident memory is read from /proc, and glibc's heap trimmed")
    gc.collect()
    libc.malloc_trim(0)
    return int(statm.read_text().split()[1]) * resource.getpagesize() / 1024


def growth_kb(scene: HeadScene, places: np.ndarray, frames: int, keep: list[np.ndarray] | None = None) -> float:
    """Growth of the process's resident memory over so many frames, kB."""
    before = resident_kb()
    for k in range(frames):
        picture = scene.frame(places + 0.01 * (k % 7))
        if keep is not None:
            keep.append(picture)
    return resident_kb() - before


def test_a_thousand_frames_leave_nothing_behind(head: Head) -> None:
    # One part, all vertices: what could be left behind is as large, and drawing is quick.
    others = tuple(part for part in head.parts if part != "lids")
    with HeadScene(head, (200, 200), textured=False, without=others) as scene:
        growth_kb(scene, head.vertices, 100)  # buffers of the driver and of the allocator
        # A picture has 120 kB, positions and normals 16 kB each: keeping the smallest of them would be 16 MB.
        assert growth_kb(scene, head.vertices, 1000) < 4_000
        # Control: pictures that are kept are noticed.
        assert growth_kb(scene, head.vertices, 100, keep=[]) > 4_000
    scene.close()  # twice does no harm


@pytest.mark.slow
def test_no_background_shows_between_hair_and_plate():
    from scipy.ndimage import binary_erosion, binary_fill_holes

    from evalkit.render.head_views import View, draw_head
    from evalkit.render.offscreen import offscreen_plotter

    head = load_head()

    def magenta_inside(sorted_layers: bool) -> int:
        with offscreen_plotter(700, 700, border=False) as plotter:
            plotter.set_background("#ff00ff")
            draw_head(plotter, head, View(yaw_deg=28.0))
            if sorted_layers:
                plotter.renderer.SetUseOIT(True)
            picture = np.asarray(plotter.screenshot(return_img=True), dtype=int)
        # No colour of the head has more blue than green by so much.
        seen = picture[..., 2] - picture[..., 1] > 40
        # The outline is soft: hair ends over some ten pixels.
        inside = binary_erosion(binary_fill_holes(picture[..., 2] - picture[..., 1] < 120), iterations=12)
        return int((seen & inside)[:300].sum())

    assert magenta_inside(sorted_layers=False) == 0
    # Control: the pass that is switched off draws the line.
    assert magenta_inside(sorted_layers=True) > 20
