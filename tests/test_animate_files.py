"""What evalkit animate writes: video, moving mesh and pictures; and its command line."""

from __future__ import annotations

import itertools
import json
import subprocess
import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from small_head import head_to_draw, small_head

import evalkit
from evalkit.animation import animate
from evalkit.animation.gltf import TOLERANCE_MM, write_glb
from evalkit.bundled import bundled_take
from evalkit.cli.animate import animate as command
from evalkit.errors import EvalkitError
from evalkit.render import face_figures
from evalkit.render.face_figures import write_snapshots
from evalkit.render.playback import HELD_MARK, pictures, write_video

FRAMES = 24


@pytest.fixture(scope="module")
def take():
    whole = evalkit.read_capture(bundled_take("talking")[0])
    points = np.array(whole.points[440 : 440 + FRAMES])
    points[15:24, whole.labels.index("Chin")] = np.nan
    return evalkit.Capture(points, whole.labels, whole.rate)


@pytest.fixture(scope="module")
def made(take):
    return animate(take, small_head())


@pytest.fixture
def files(tmp_path, take):
    small_head().save(tmp_path / "head.npz")
    evalkit.write_capture(take, tmp_path / "take.c3d")
    return tmp_path


def run(*arguments):
    """Exit code, what was printed, and the one line of an error."""
    from evalkit.cli import app

    done = CliRunner().invoke(app, ["animate", *map(str, arguments)])
    error = str(done.exception) if isinstance(done.exception, EvalkitError) else ""
    return done.exit_code, done.output, error


def decoded(path, width, height):
    """Every frame of a video, and its length in seconds."""
    import imageio_ffmpeg

    program = imageio_ffmpeg.get_ffmpeg_exe()
    arguments = ["-v", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run([program, *arguments], capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, height, width, 3), imageio_ffmpeg.count_frames_and_secs(path)[1]


def test_a_video_has_every_frame_at_its_rate_and_no_two_alike(tmp_path, made):
    head_to_draw()
    advanced = []
    write_video(made, tmp_path / "face.mp4", size=96, side_by_side=True, advance=advanced.append)
    frames, seconds = decoded(tmp_path / "face.mp4", 288, 96)
    assert len(frames) == FRAMES == sum(advanced)
    # Told to the hundredth of a second.
    assert seconds == pytest.approx(FRAMES / made.rate_hz, abs=0.01)
    # Rendered anew each time: decoded heads of successive frames differ, which a picture shown twice does not.
    heads = [frame[:, 192:].astype(int) for frame in frames]
    assert all(np.abs(a - b).mean() > 0.05 for a, b in itertools.pairwise(heads))
    # The chin is held from frame 15 on: a bar says so over the head or the panels, and only there.
    bar = np.array([np.abs(frame[0].astype(int) - HELD_MARK).max(axis=1).mean() for frame in frames])
    assert (bar[15:] < 60).all()
    assert (bar[:15] > 100).all()
    assert list(tmp_path.iterdir()) == [tmp_path / "face.mp4"]


def test_a_gif_is_written_too(tmp_path, made):
    head_to_draw()
    write_video(made, tmp_path / "face.gif", size=64)
    with Image.open(tmp_path / "face.gif") as film:
        assert film.n_frames == FRAMES


def test_pictures_are_the_same_again(made):
    head_to_draw()
    first, again = (list(pictures(made, size=64)) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_a_video_that_fails_leaves_nothing(tmp_path, made):
    head_to_draw()

    def stop(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(made, tmp_path / "face.mp4", size=64, advance=stop)
    assert not list(tmp_path.iterdir())
    with pytest.raises(EvalkitError, match=r"written as \.mp4 or \.gif"):
        write_video(made, tmp_path / "face.avi")
    with pytest.raises(EvalkitError, match="3000 pixels"):
        write_video(made, tmp_path / "face.mp4", size=3000)


def vtk_frame(path, seconds):
    """Vertices, m, of the mesh at a time as VTK's own glTF reader evaluates skinless morphs and node motion."""
    import pyvista
    from vtkmodules.vtkIOGeometry import vtkGLTFReader

    reader = vtkGLTFReader()
    reader.SetFileName(str(path))
    reader.ApplyDeformationsToGeometryOn()
    reader.UpdateInformation()
    reader.EnableAnimation(0)
    reader.SetFrameRate(60)
    reader.UpdateInformation()
    reader.UpdateTimeStep(seconds)
    blocks = pyvista.wrap(reader.GetOutput())
    while isinstance(blocks, pyvista.MultiBlock):
        blocks = blocks[0]
    return np.asarray(blocks.points, dtype=np.float64)


def test_the_moving_mesh_is_that_of_the_animation_to_another_reader(tmp_path, made):
    told = write_glb(made, tmp_path / "face.glb")
    assert told["largest_error_mm"] <= TOLERANCE_MM
    assert told["rms_error_mm"] <= told["largest_error_mm"]
    assert 0 < told["targets"] <= 96
    rest = 1000 * vtk_frame(tmp_path / "face.glb", 0.0)
    for frame in (0, 7, 16, FRAMES - 1):
        ours = made.vertices([frame])[0] @ made.rotations[frame].T + made.translations[frame]
        theirs = 1000 * vtk_frame(tmp_path / "face.glb", frame / made.rate_hz)
        # What was stated, and 0.05 mm for single precision over 300 mm with dozens of weights.
        assert np.linalg.norm(ours - theirs, axis=1).max() <= told["largest_error_mm"] + 0.05
    # Control: another frame is not within it.
    assert np.linalg.norm(ours - rest, axis=1).max() > 5 * TOLERANCE_MM


def test_the_mesh_decodes_with_normals_texture_and_all_triangles(tmp_path, made):
    trimesh = pytest.importorskip("trimesh")
    write_glb(made, tmp_path / "face.glb")
    with warnings.catch_warnings():
        # The reader's own, about NumPy's future; nothing of the file.
        warnings.simplefilter("ignore", DeprecationWarning)
        scene = trimesh.load_scene(tmp_path / "face.glb", process=False)
    meshes = list(scene.geometry.values())
    head = made.head
    assert sum(len(mesh.faces) for mesh in meshes) == len(head.triangles)
    for mesh in meshes:
        used = np.unique(mesh.faces)
        if len(mesh.vertices) == len(head.vertices):
            np.testing.assert_allclose(1000 * mesh.vertices[used], head.vertices[used], atol=1e-4)
            uv = np.asarray(mesh.visual.uv)[used]
            np.testing.assert_allclose(uv, head.uv[used], atol=1e-5)
        picture = mesh.visual.material.baseColorTexture
        np.testing.assert_array_equal(np.asarray(picture), head.texture)
    lengths = np.linalg.norm(meshes[0].vertex_normals, axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-5)


def test_a_face_at_rest_needs_no_targets_and_still_is_a_mesh(tmp_path):
    head = small_head()
    sites = np.array(list(head.marker_sites.values()))
    still = evalkit.Capture(np.repeat(sites[None], 10, axis=0), list(head.marker_sites), 60.0)
    made = animate(still, head, compensated=True, head_motion="still", seed=3)
    assert (made.lids_closed == 0).all()
    assert write_glb(made, tmp_path / "still.glb")["targets"] == 0
    np.testing.assert_allclose(1000 * vtk_frame(tmp_path / "still.glb", 0.0), head.vertices, atol=1e-4)


def test_snapshots_are_pictures_with_a_head_in_them(tmp_path, made, monkeypatch):
    head_to_draw()
    monkeypatch.setattr(face_figures, "SIZE", 160)
    monkeypatch.setattr(face_figures, "SHEET_FRAMES", 4)
    names = write_snapshots(made, tmp_path)
    assert set(names) == {"markers.png", "head.png", "landmarks.png", "snapshots.png", "sheet.png"}
    for name in names:
        with Image.open(tmp_path / name) as picture:
            pixels = np.asarray(picture.convert("RGB")).astype(int)
        # Skin is redder than blue over a good part of any of them, except where only markers are drawn.
        assert (pixels[..., 0] - pixels[..., 2] > 30).mean() > 0.03, name


def test_the_command_writes_and_says_what_it_did(files):
    head_to_draw()
    code, text, _ = run(files / "take.c3d", "--head", files / "head.npz", "-o", files / "face.mp4", "--size", 64)
    assert code == 0
    assert "23 markers matched by their names" in text
    assert "from nose tip to chin" in text
    assert "frames marked" in text
    assert (files / "face.mp4").is_file()
    code, text, _ = run(
        files / "take.c3d", "--head", files / "head.npz", "-o", files / "face.glb", "--fps", "30", "--still", "--json"
    )
    told = json.loads(text)
    assert code == 0
    assert told["rate_hz"] == 30
    assert told["resampling"] == "linear between the two nearest frames"
    assert told["output"]["targets"] > 0
    assert told["head_motion"] == "still"
    assert set(told["scaling"]) == {"upper x", "upper y", "lower x", "lower y", "z"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "{}/face.avi"), "written as"),
        (("-o", "{}/no/face.mp4"), "no such folder"),
        (("-o", "{}/face.mp4", "--fps", "x"), "--fps x"),
        (("-o", "{}/face.mp4", "--neutral", "x"), "--neutral x"),
        (("-o", "{}/face.mp4", "--neutral", "16"), "Chin is not seen"),
        (("-o", "{}/face.mp4", "--map", "Chn=Chin"), "no marker 'Chn'"),
        (("-o", "{}/face.mp4", "--map", "nowhere.json"), "neither a file"),
        (("-o", "{}/face.mp4", "--head", "{}/none.npz"), "no such file"),
    ],
)
def test_a_users_mistake_is_one_line_and_nothing_is_written(files, arguments, words):
    before = sorted(files.iterdir())
    options = [argument.format(files) for argument in arguments]
    head = [] if "--head" in options else ["--head", files / "head.npz"]
    code, _, error = run(files / "take.c3d", *head, *options)
    assert code == 1
    assert words in error
    assert "\n" not in error
    assert sorted(files.iterdir()) == before


def test_wrong_usage_and_help():
    assert run("take.c3d")[0] == 2
    code, text, _ = run("--help")
    assert code == 0
    assert "Examples:" in text
    assert command.name == "animate"


def test_a_whole_body_take_without_a_face_is_one_line(files):
    body = evalkit.Capture(np.random.default_rng(0).normal(size=(9, 6, 3)) * 100, ["LFHD", "RFHD", *"abcd"], 60.0)
    evalkit.write_capture(body, files / "body.c3d")
    code, _, error = run(files / "body.c3d", "--head", files / "head.npz", "--compensated", "-o", files / "face.mp4")
    assert code == 1
    assert "--map" in error
    assert "\n" not in error
