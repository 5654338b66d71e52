"""Frames of a video file, a folder of pictures or a camera, one after the other, in bounded memory."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# Read by OpenCV when it first meets FFmpeg: what is wrong with a file is said once, by the error raised here.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import cv2

from evalkit.errors import EvalkitError
from evalkit.vision.tracker import Picture

PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}
ASSUMED_RATE_HZ = 25.0
"""Frame rate of a folder of pictures, and of a file that does not say a possible one."""

LARGEST_RATE_HZ = 1000.0

ANSI = int.from_bytes(b"ansi", "little")
"""Code of FFmpeg's reader of plain text, which makes a film of the letters."""


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep OpenCV from writing to the terminal: what is wrong is said by the error raised here."""
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


@dataclass(frozen=True)
class Video:
    """Frames that can be gone through any number of times; a camera goes on where it is.

    Iteration gives :data:`~evalkit.vision.tracker.Picture` (H, W, 3) and raises :class:`EvalkitError` at a frame that
    cannot be read or has another size than the first.

    Attributes
    ----------
    source : Path or int
        File, folder or number of the camera.
    size : (int, int)
        Width and height of the first frame, pixels.
    rate_hz : float
        Frames per second: as given, else as the file says, else :data:`ASSUMED_RATE_HZ`.
    claimed_count : int or None
        Frames according to the file's header, which may be wrong: only for a progress bar. None where nobody knows.
    """

    source: Path | int
    size: tuple[int, int]
    rate_hz: float
    claimed_count: int | None

    def __iter__(self) -> Iterator[Picture]:
        for index, (name, frame) in enumerate(_frames(self.source)):
            height, width = frame.shape[:2]
            if (width, height) != self.size:
                raise EvalkitError(
                    f"{name}: frame {index} has {width} x {height} pixels, the first one {self.size[0]} x "
                    f"{self.size[1]}; all frames must have one size"
                )
            yield frame


def read_video(source: str | Path | int, rate_hz: float | None = None) -> Video:
    """Open a video.

    Parameters
    ----------
    source : str, Path or int
        A video file, a folder of pictures (taken in the order of the numbers in their names), or the number of a
        camera, 0 for the first.
    rate_hz : float, optional
        Frames per second, instead of what the file says.

    Raises
    ------
    EvalkitError
        If there is no such file or camera, it is no video, it holds no frame, or the rate is no positive number.
    """
    if rate_hz is not None and not (math.isfinite(rate_hz) and rate_hz > 0):
        raise EvalkitError(f"{source}: a rate of {rate_hz} frames per second is not a positive number")
    where = source if isinstance(source, int) else Path(source)
    claimed_rate, claimed_count = _claims(where)
    first = next(_frames(where), None)
    if first is None:
        raise EvalkitError(f"{where}: no frame in it can be read; is it a complete video file?")
    frame = first[1]
    return Video(where, (frame.shape[1], frame.shape[0]), rate_hz or claimed_rate or ASSUMED_RATE_HZ, claimed_count)


def _claims(source: Path | int) -> tuple[float | None, int | None]:
    """Rate and number of frames as the source states them, None where what it states is impossible."""
    if isinstance(source, Path) and source.is_dir():
        return None, len(_pictures(source))
    capture = _open(source)
    rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
    capture.release()
    rate_known = math.isfinite(rate) and 0 < rate <= LARGEST_RATE_HZ
    count_known = isinstance(source, Path) and math.isfinite(count) and count >= 1
    return (rate if rate_known else None), (int(count) if count_known else None)


def _frames(source: Path | int) -> Iterator[tuple[str, Picture]]:
    """Name (for messages) and picture of each frame."""
    if isinstance(source, Path) and source.is_dir():
        for path in _pictures(source):
            yield str(path), _picture(path)
        return
    capture = _open(source)
    try:
        while True:
            with _quiet():
                read, frame = capture.read()
            if not read or frame is None or not frame.size:
                return
            yield str(source), np.asarray(frame, dtype=np.uint8)
    finally:
        capture.release()


def _open(source: Path | int) -> cv2.VideoCapture:
    if isinstance(source, int):
        with _quiet():
            capture = cv2.VideoCapture(source)
        if not capture.isOpened():
            raise EvalkitError(f"camera {source}: cannot be opened; is it connected, and not in use?")
        return capture
    if not source.is_file():
        raise EvalkitError(f"{source}: no such file or folder; give a video, a folder of pictures or a camera's number")
    # FFmpeg alone: other readers take a name with % for a pattern of pictures.
    with _quiet():
        capture = cv2.VideoCapture(str(source), cv2.CAP_FFMPEG)
    if not capture.isOpened() or int(capture.get(cv2.CAP_PROP_FOURCC)) == ANSI:
        raise EvalkitError(f"{source}: not a video that FFmpeg can read")
    return capture


def _pictures(folder: Path) -> list[Path]:
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES and not path.name.startswith(".")]
    if not found:
        raise EvalkitError(f"{folder}: no pictures in this folder ({', '.join(sorted(PICTURES))})")
    return sorted(found, key=_natural)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key by which frame 10 comes after frame 9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _picture(path: Path) -> Picture:
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    with _quiet():
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if picture is None:
        raise EvalkitError(f"{path}: not a picture that OpenCV can read")
    return np.asarray(picture, dtype=np.uint8)
