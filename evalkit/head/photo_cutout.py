"""What of a photo is the head, and what is behind it: cutting out hair and painting over what is covered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array

EDGE_CONTRAST = 90.0
"""How strongly a change of colour separates neighbouring pixels, against the mean squared change in the picture."""


def sampled(picture: NDArray[np.uint8], pixels: Array, blur: float = 0.0) -> Array:
    """Colours (..., 3) of a picture at pixels (..., 2), bilinear; outside of it the nearest.

    Parameters
    ----------
    picture : ndarray of uint8, shape (H, W, 3)
    pixels : ndarray, shape (..., 2)
        x, y with the origin at the corner of the first pixel.
    blur : float, pixels
        Standard deviation of a Gaussian before: for a picture that is finer than the places asked for.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates

    at = np.moveaxis(pixels, -1, 0)[::-1] - 0.5
    out = np.empty((*pixels.shape[:-1], 3), dtype=np.float32)
    for channel in range(3):
        plane = picture[..., channel].astype(np.float32)
        if blur > 0.3:
            plane = gaussian_filter(plane, blur, mode="nearest")
        out[..., channel] = map_coordinates(plane, at, order=1, mode="nearest")
    return out


def filled(values: Array, weight: Array) -> Array:
    """Values (H, W, C) where their weight (H, W) is 1, smoothly spread from there to where it is 0.

    Weighted means over pixels twice as large each time, and back.

    References
    ----------
    Gortler et al., "The Lumigraph", SIGGRAPH 1996, doi:10.1145/237170.237200, section 3.4 (push-pull).
    """
    if min(weight.shape) <= 2:
        total = weight.sum()
        mean = (values * weight[..., None]).sum(axis=(0, 1)) / total if total > 0 else values.mean(axis=(0, 1))
        return np.where(weight[..., None] > 0, values, mean)
    height, width = weight.shape
    odd = ((0, height % 2), (0, width % 2))
    heavy = np.pad(weight, odd, mode="edge")
    summed = np.pad(values * weight[..., None], (*odd, (0, 0)), mode="edge")
    heavy = heavy.reshape(heavy.shape[0] // 2, 2, heavy.shape[1] // 2, 2).sum(axis=(1, 3))
    summed = summed.reshape(summed.shape[0] // 2, 2, summed.shape[1] // 2, 2, -1).sum(axis=(1, 3))
    coarse = filled(summed / np.maximum(heavy, 1e-6)[..., None], np.minimum(heavy, 1.0))
    fine = doubled(coarse)[:height, :width]
    return np.asarray(weight[..., None] * values + (1.0 - weight[..., None]) * fine)


def doubled(values: Array) -> Array:
    """Values (H, W, C) with twice as many pixels each way, linear in between."""
    for axis in (0, 1):
        values = np.moveaxis(values, axis, 0)
        before = np.concatenate([values[:1], values[:-1]])
        after = np.concatenate([values[1:], values[-1:]])
        out = np.empty((2 * len(values), *values.shape[1:]), dtype=values.dtype)
        out[0::2], out[1::2] = 0.75 * values + 0.25 * before, 0.75 * values + 0.25 * after
        values = np.moveaxis(out, 0, axis)
    return values


def foreground(colours: Array, inside: NDArray[np.bool_], outside: NDArray[np.bool_]) -> Array:
    """Share (H, W), 0 to 1, to which pixels belong to what is known to be inside.

    The probability that a random walk from a pixel, which crosses edges of colour rarely, meets a pixel known to be
    inside before one known to be outside.

    Parameters
    ----------
    colours : ndarray, shape (H, W, 3)
    inside, outside : ndarray of bool, shape (H, W)

    References
    ----------
    Grady, "Random walks for image segmentation", IEEE PAMI 28, 2006, doi:10.1109/TPAMI.2006.233.
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu

    height, width = inside.shape
    number = np.arange(height * width).reshape(height, width)
    pairs = np.concatenate(
        [
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
            np.stack([number[:-1].ravel(), number[1:].ravel()]),
        ],
        axis=1,
    )
    flat = colours.reshape(-1, 3).astype(np.float64)
    change = ((flat[pairs[0]] - flat[pairs[1]]) ** 2).sum(axis=1)
    # The smallest weight keeps the system regular where a pixel differs from all around it.
    weight = np.exp(-EDGE_CONTRAST * change / max(change.max(), 1e-9)) + 1e-4
    graph = sparse.coo_array((weight, pairs), shape=(flat.shape[0],) * 2).tocsr()
    graph = graph + graph.T
    laplacian = (sparse.diags_array(graph.sum(axis=1)) - graph).tocsr()
    known = (inside | outside).ravel()
    free, held = np.flatnonzero(~known), np.flatnonzero(known)
    out = inside.ravel().astype(np.float64)
    if len(free) and len(held):
        out[free] = splu(laplacian[free][:, free].tocsc()).solve(-(laplacian[free][:, held] @ out[held]))
    return np.clip(out, 0.0, 1.0).reshape(height, width)


def silhouette(triangles: Array, low: Array, high: Array, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels that triangles (T, 3, 2) cover in a picture of the rectangle from low to high, first row on top."""
    from PIL import Image, ImageDraw

    height, width = shape
    scale = np.array([width, -height]) / (high - low)
    corners = (triangles - [low[0], high[1]]) * scale
    image = Image.new("1", (width, height))
    draw = ImageDraw.Draw(image)
    for corner in corners.reshape(-1, 6).tolist():
        draw.polygon(corner, fill=1)
    return np.array(image)
