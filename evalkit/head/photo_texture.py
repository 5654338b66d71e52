"""The photo as the texture of a fitted head."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evalkit.geometry import Array
from evalkit.head.model import Head
from evalkit.head.photo import Photo
from evalkit.head.photo_warp import Similarity


def textured(head: Head, photo: Photo, view: Similarity, places: dict[str, Array]) -> Head:
    """The head with the photo on it, seen along z."""
    assert head.uv is not None and head.texture is not None
    from scipy.interpolate import LinearNDInterpolator
    from scipy.ndimage import map_coordinates

    size = 1024
    u = (np.arange(size) + 0.5) / size
    rows = 3 * size // 4
    picture = np.array(head.texture[:: head.texture.shape[0] // size, :: head.texture.shape[1] // size])
    skin = head.skin_vertices
    found = LinearNDInterpolator(head.uv[skin], head.vertices[skin], fill_value=0.0)(*np.meshgrid(u, 1.0 - u[:rows]))
    pixels = view.to_photo(found) * photo.scale - 0.5
    for channel in range(3):
        picture[:rows, :, channel] = map_coordinates(
            photo.pixels[..., channel].astype(np.float32), [pixels[..., 1], pixels[..., 0]], order=1, mode="nearest"
        )
    return replace(head, texture=picture)
