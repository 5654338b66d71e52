"""What happens to a picture between the face and the file: clutter behind, something before it, light that changes,
noise of the sensor, a real encoder.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.seeds import generator
from evalkit.synthetic.motion import hum

Image = NDArray[np.uint8]

OCCLUDERS = ("none", "hand", "bar")

SHOT = 0.6
"""Variance of the noise added by every 25 grey levels, relative to that in the dark: a cheap sensor's photons."""

DRIFT_HZ = (0.2, 1.5)
"""Band in which light drifts: clouds, automatic exposure."""

BEAT_HZ = 7.0
"""Beat of lamps at 100 or 120 Hz with a camera's frames."""


def clutter(size: tuple[int, int], seed: int) -> Image:
    """A room full of things, (H, W, 3): blocks, discs and lines of all sizes over uneven walls.

    A plain background would tell a tracker where the head ends.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFilter

    random = generator("video", "clutter", seed=seed)
    width, height = size
    walls = np.zeros((height, width, 3))
    for cells in (3, 8, 20, 60):
        grain = random.uniform(-1.0, 1.0, (cells, cells, 3)) * 90.0 / np.sqrt(cells)
        layer = [
            np.asarray(Pillow.fromarray(grain[..., k].astype(np.float32)).resize(size, Pillow.Resampling.BICUBIC))
            for k in range(3)
        ]
        walls += np.stack(layer, axis=-1)
    picture = Pillow.fromarray(np.clip(random.uniform(90.0, 170.0, 3) + walls, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    for _ in range(45):
        x, y = random.uniform(0, width), random.uniform(0, height)
        w, h = random.uniform(0.02, 0.25, 2) * width
        colour = tuple(int(c) for c in random.integers(20, 235, 3))
        shape = random.integers(3)
        if shape == 0:
            draw.rectangle([x, y, x + w, y + h], fill=colour)
        elif shape == 1:
            draw.ellipse([x, y, x + w, y + h], fill=colour)
        else:
            draw.line([x, y, x + 2 * w - h, y + h], fill=colour, width=int(random.integers(1, 6)))
    return np.asarray(picture.filter(ImageFilter.GaussianBlur(0.8)))


def occluder_sprite(kind: str, face_px: float, seed: int) -> Image:
    """A picture (h, w, 4) of something that passes before a face of so many pixels in width, with its opacity.

    A hand of four fingers on an arm from below, or an upright bar with stripes such as a microphone's stand.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFilter

    random = generator("video", "occluder", kind, seed=seed)
    scale, finer = face_px / 100.0, 3
    width, height = (round(side * scale) for side in ((62, 230) if kind == "hand" else (32, 320)))
    mask = Pillow.new("L", (finer * width, finer * height), 0)
    draw = ImageDraw.Draw(mask)
    s = finer * scale
    if kind == "hand":
        draw.rounded_rectangle([6 * s, 52 * s, 56 * s, 112 * s], 14 * s, fill=255)
        draw.rectangle([14 * s, 100 * s, 48 * s, 230 * s], fill=255)
        for k, top in enumerate((16.0, 4.0, 0.0, 9.0)):
            left = 6 + 12.6 * k
            draw.rounded_rectangle([left * s, top * s, (left + 11.5) * s, 74 * s], 5.5 * s, fill=255)
    else:
        draw.rectangle([0, 0, finer * width, finer * height], fill=255)
    opacity = np.asarray(mask.resize((width, height), Pillow.Resampling.BOX).filter(ImageFilter.GaussianBlur(0.5)))
    rows, columns = np.mgrid[:height, :width] / scale
    colour = np.array([196.0, 150.0, 128.0] if kind == "hand" else [70.0, 80.0, 95.0])
    # Knuckles and veins, or stripes: a plain thing would be too easy to tell from a face.
    waves = 14.0 * np.sin(rows / 7.0 + np.sin(columns / 5.0)) if kind == "hand" else 40.0 * np.sign(np.sin(rows / 6.0))
    grain = random.normal(0.0, 7.0, (height, width))
    skin = np.clip(colour + (waves + grain)[..., None], 0, 255)
    return np.concatenate([skin, opacity[..., None]], axis=2).astype(np.uint8)


def covered(picture: Image, sprite: Image, left_px: float, top_px: float) -> tuple[Image, NDArray[np.bool_]]:
    """A picture behind a sprite whose upper left corner is at a place, and where it is hidden, (H, W)."""
    from PIL import Image as Pillow

    height, width = picture.shape[:2]
    moved = Pillow.fromarray(sprite, "RGBA").transform(
        (width, height), Pillow.Transform.AFFINE, (1, 0, -left_px, 0, 1, -top_px), Pillow.Resampling.BILINEAR
    )
    layer = np.asarray(moved).astype(np.float64)
    share = layer[..., 3:] / 255.0
    mixed = picture * (1.0 - share) + layer[..., :3] * share
    return np.rint(mixed).astype(np.uint8), share[..., 0] > 0.5


def gains(times_s: Array, size: float, seed: int) -> Array:
    """Brightness of every frame relative to the first, (F,): slow drift, a beat, and jitter of the exposure."""
    if size == 0.0:
        return np.ones(len(times_s))
    random = generator("video", "light", seed=seed)
    drift = hum(times_s, DRIFT_HZ, random)
    beat = np.sin(2.0 * np.pi * (BEAT_HZ * times_s + random.random()))
    log = size * (0.7 * drift + 0.25 * beat + 0.1 * random.standard_normal(len(times_s)))
    return np.asarray(np.exp(log - log[0]))


def sensed(picture: Image, gain: float, noise: float, random: np.random.Generator) -> Image:
    """What a sensor makes of a picture (H, W, 3): gain, shot noise and noise of reading, 8 bits."""
    lit = np.asarray(picture, dtype=np.float64) * gain
    if noise:
        lit = lit + noise * np.sqrt(1.0 + SHOT * np.maximum(lit, 0.0) / 25.0) * random.standard_normal(lit.shape)
    return np.clip(np.rint(lit), 0, 255).astype(np.uint8)


def write_h264(frames: Sequence[Image], path: Path, rate_hz: float, crf: int) -> None:
    """Pictures (H, W, 3), red, green, blue, as a video file in H.264.

    Raises
    ------
    EvalkitError
        If the encoder fails.
    """
    height, width = frames[0].shape[:2]
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate_hz:g}", "-i", "-"]
    # One thread: how frames are shared among threads changes what is kept of them.
    coded = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", str(crf), "-preset", "veryfast", "-threads", "1"]
    _ffmpeg([*raw, *coded, "-movflags", "+faststart", str(path)], b"".join(frame.tobytes() for frame in frames), path)


def compressed(frames: Sequence[Image], rate_hz: float, crf: int) -> Image:
    """Pictures (F, H, W, 3) after an encoder and its decoder; as they are where the factor is 0.

    Raises
    ------
    EvalkitError
        If the encoder fails.
    """
    if not crf:
        return np.stack(list(frames))
    with tempfile.TemporaryDirectory(prefix="evalkit-video-") as folder:
        path = Path(folder) / "video.mp4"
        write_h264(frames, path, rate_hz, crf)
        back = _ffmpeg(["-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], b"", path)
    found = np.frombuffer(back, dtype=np.uint8).reshape(-1, *frames[0].shape)
    if len(found) != len(frames):
        raise EvalkitError(f"{len(found)} of {len(frames)} frames came back from the encoder")
    return found


def _ffmpeg(arguments: Sequence[str], given: bytes, path: Path) -> bytes:
    """What FFmpeg, as imageio-ffmpeg brings it, writes to its output."""
    import imageio_ffmpeg

    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", *arguments]
    done = subprocess.run(command, input=given, capture_output=True, check=False)
    if done.returncode:
        words = done.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
        raise EvalkitError(f"{path}: the video cannot be written ({words[-1]})")
    return done.stdout
