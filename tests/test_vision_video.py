"""Reading frames: whatever a user points at, frames come or one clear line does."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from evalkit.errors import EvalkitError

cv2 = pytest.importorskip("cv2")

from evalkit.vision.video import ASSUMED_RATE_HZ, read_video  # noqa: E402


def write_video(path, frames, rate=30.0):
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), rate, (width, height))
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


def grey(level, size=(64, 48)):
    return np.full((size[1], size[0], 3), level, dtype=np.uint8)


def test_frames_of_a_file_come_in_order_and_twice(tmp_path):
    path = write_video(tmp_path / "a 100%.mp4", [grey(20 * k) for k in range(10)])
    video = read_video(str(path))
    assert video.size == (64, 48)
    assert video.rate_hz == pytest.approx(30.0)
    for _ in range(2):
        levels = [frame.mean() for frame in video]
        # A lossy codec keeps flat grey to a few levels.
        np.testing.assert_allclose(levels, 20.0 * np.arange(10), atol=4)
    assert read_video(path, rate_hz=12.5).rate_hz == 12.5


def test_what_the_header_says_about_the_count_does_not_matter(tmp_path):
    path = write_video(tmp_path / "whole.avi", [grey(20 * k) for k in range(10)])
    cut = tmp_path / "cut.avi"
    data = path.read_bytes()
    cut.write_bytes(data[: data.index(b"movi") + (len(data) - data.index(b"movi")) // 2])
    video = read_video(cut)
    assert video.claimed_count == 10
    assert 0 < len(list(video)) < 10


def test_folder_in_natural_order(tmp_path):
    for k in range(12):
        cv2.imwrite(str(tmp_path / f"frame{k}.png"), grey(20 * k))
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / ".hidden.png").write_text("no picture")
    video = read_video(tmp_path)
    assert video.claimed_count == 12
    assert video.rate_hz == ASSUMED_RATE_HZ
    assert [int(frame[0, 0, 0]) for frame in video] == [20 * k for k in range(12)]


def test_frames_are_not_kept(tmp_path):
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), grey(k))
    frames = iter(read_video(tmp_path))
    next(frames)
    # A frame that goes away before its turn is missed only then: nothing was read ahead.
    (tmp_path / "2.png").unlink()
    next(frames)
    with pytest.raises(EvalkitError, match=r"2\.png: cannot be read"):
        next(frames)


def test_frames_of_variable_size_are_named(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), grey(0))
    cv2.imwrite(str(tmp_path / "1.png"), grey(0, size=(32, 24)))
    with pytest.raises(EvalkitError, match=r"1\.png: frame 1 has 32 x 24 pixels, the first one 64 x 48"):
        list(read_video(tmp_path))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("absent.mp4", None, "no such file or folder"),
        ("text.mp4", b"This is no video.\n" * 50, "not a video"),
        ("text.txt", b"This is no video.\n" * 50, "not a video"),
        ("empty.mp4", b"", "not a video"),
        ("noise.mp4", np.random.default_rng(0).bytes(20000), "not a video"),
    ],
)
def test_no_video(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(EvalkitError, match=message) as caught:
        read_video(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_video_without_frames(tmp_path):
    path = write_video(tmp_path / "none.avi", [grey(k) for k in range(5)])
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"movi") + 4])
    with pytest.raises(EvalkitError, match=r"none\.avi: (no frame|not a video)"):
        read_video(path)


def test_folders_that_cannot_be_used(tmp_path):
    with pytest.raises(EvalkitError, match="no pictures in this folder"):
        read_video(tmp_path)
    (tmp_path / "a.png").write_bytes(b"no picture")
    with pytest.raises(EvalkitError, match=r"a\.png: not a picture"):
        read_video(tmp_path)
    (tmp_path / "a.png").write_bytes(b"")
    with pytest.raises(EvalkitError, match=r"a\.png: not a picture"):
        read_video(tmp_path)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_impossible_rate(tmp_path, rate):
    with pytest.raises(EvalkitError, match="not a positive number"):
        read_video(tmp_path, rate_hz=rate)


def test_the_native_reader_is_quiet(tmp_path):
    """Nothing reaches the terminal but the error: FFmpeg and libpng write to it on their own."""
    whole = write_video(tmp_path / "whole.mp4", [grey(k) for k in range(30)])
    (tmp_path / "cut.mp4").write_bytes(whole.read_bytes()[:-300])
    cv2.imwrite(str(tmp_path / "whole.png"), np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8))
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "cut.png").write_bytes((tmp_path / "whole.png").read_bytes()[:2000])
    program = """
import sys
from evalkit.errors import EvalkitError
from evalkit.vision.video import read_video
for source in (*sys.argv[1:], 99):
    try:
        list(read_video(source))
    except EvalkitError as error:
        print(error)
"""
    sources = [str(tmp_path / "cut.mp4"), str(tmp_path / "pictures")]
    done = subprocess.run([sys.executable, "-c", program, *sources], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert len(done.stdout.splitlines()) >= 2
