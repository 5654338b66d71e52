"""Pictures into a video file (H.264), one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError

CRF = 20
"""Constant rate factor: 18 is said to look like the original."""


@contextmanager
def written_video(
    path: Path, size: tuple[int, int], rate_hz: float, crf: int = CRF
) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """A file that pictures are added to; made even, as the encoder wants it.

    What comes out of the context adds a picture (H, W, 3), blue, green, red.

    Parameters
    ----------
    path : Path
        ``.mp4``.
    size : (int, int)
        Width and height of the pictures, pixels.
    rate_hz : float
        Frames per second.
    crf : int

    Raises
    ------
    EvalkitError
        If the encoder fails.
    """
    import imageio_ffmpeg

    made = imageio_ffmpeg.write_frames(
        str(path), size, pix_fmt_in="bgr24", fps=rate_hz, codec="libx264", pix_fmt_out="yuv420p", quality=None,
        macro_block_size=2, ffmpeg_log_level="error",
        output_params=["-crf", str(crf), "-preset", "veryfast", "-movflags", "+faststart"],
    )  # fmt: skip

    def add(picture: NDArray[np.uint8]) -> None:
        try:
            made.send(np.ascontiguousarray(picture))
        except OSError as error:
            reason = str(error).strip().splitlines()[-1] if str(error).strip() else "no reason given"
            raise EvalkitError(f"{path.name}: the video cannot be written ({error.strerror or reason})") from error

    made.send(None)
    try:
        yield add
    finally:
        made.close()
