"""A photo of a face as an upright picture, at a size that can be worked with."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError

WORKING_PIXELS = 2048
"""Longest side of the picture that is worked with: a face that fills it gives the head's texture all it can hold."""

LARGEST_MEGAPIXELS = 200
"""Larger pictures are refused: decoded, they would take more than half a gigabyte."""


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo, upright.

    Attributes
    ----------
    pixels : ndarray of uint8, shape (H, W, 3)
        Red, green, blue, first row on top; no side longer than :data:`WORKING_PIXELS`.
    size : (int, int)
        Width and height of the photo itself, upright. Points are in these pixels, with the origin at the upper
        left corner of the first pixel, whose middle is (0.5, 0.5).
    path : str
        Where it was read.
    sha256 : str
        Of the file.
    """

    pixels: NDArray[np.uint8]
    size: tuple[int, int]
    path: str
    sha256: str

    @property
    def scale(self) -> float:
        """Pixels of `pixels` per pixel of the photo itself."""
        return self.pixels.shape[1] / self.size[0]


def read_photo(path: str | Path) -> Photo:
    """Read a photo: JPEG, PNG, WebP, TIFF or whatever else Pillow reads.

    Turned upright as its EXIF data say; greyscale and palettes become RGB, transparency becomes white.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Photo

    Raises
    ------
    EvalkitError
        If the file is missing, empty, cut short, animated, too large or no picture.
    """
    import warnings

    from PIL import Image, ImageOps

    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not content:
        raise EvalkitError(f"{path}: the file is empty")
    try:
        with warnings.catch_warnings():
            # The limit is our own; Pillow's warning about large pictures would be a second line.
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                frames = int(getattr(image, "n_frames", 1))
                if frames > 1:
                    raise EvalkitError(f"{path}: holds {frames} pictures; give one still photo")
                if image.width * image.height > LARGEST_MEGAPIXELS * 1e6:
                    raise EvalkitError(
                        f"{path}: {image.width} x {image.height} pixels; at most {LARGEST_MEGAPIXELS} million are read"
                    )
                # A JPEG is decoded at the nearest size that is not smaller: ten times as fast for a large one.
                turned = image.getexif().get(0x0112, 1) in (5, 6, 7, 8)
                size = image.size[::-1] if turned else image.size
                image.draft("RGB", (WORKING_PIXELS, WORKING_PIXELS))
                upright = _as_rgb(ImageOps.exif_transpose(image))
    except EvalkitError:
        raise
    except Exception as error:
        # Pillow raises a dozen kinds of errors on files that are damaged or something else.
        reason = str(error).splitlines()[0] if "cannot identify" not in str(error) else "unknown format"
        raise EvalkitError(f"{path}: not a picture that can be read ({reason})") from error
    upright.thumbnail((WORKING_PIXELS, WORKING_PIXELS), Image.Resampling.LANCZOS)
    return Photo(np.array(upright), size, str(path), hashlib.sha256(content).hexdigest())


def _as_rgb(image: Any) -> Any:
    from PIL import Image

    if image.mode.startswith("I;16") or image.mode in ("I", "F"):
        # 16 bits per pixel: Pillow would cut them off, not scale them.
        values = np.asarray(image, dtype=np.float64)
        image = Image.fromarray(np.uint8(np.clip(values / max(values.max(), 1.0) * 255.0, 0, 255)))
    if "A" in image.getbands() or "transparency" in image.info:
        image = image.convert("RGBA")
        white = Image.new("RGBA", image.size, "white")
        image = Image.alpha_composite(white, image)
    return image.convert("RGB")
