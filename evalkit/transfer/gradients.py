"""Deformation gradients: the linear map that takes each triangle of a rest mesh to where a shape has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.transfer.matrices import inverse, product

Indices = NDArray[np.intp]

FLAT = 1e-12
"""A triangle whose area is below this share of the squared diagonal of the mesh has no direction across it."""


def checked_mesh(vertices: ArrayLike, triangles: ArrayLike, name: str = "rest") -> tuple[Array, Indices]:
    """A mesh that deformations can be measured on.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)

    Raises
    ------
    EvalkitError
        If a position is not finite, an index is out of range, or a triangle has no area; with its number.
    """
    try:
        v, t = np.asarray(vertices, dtype=np.float64), np.asarray(triangles)
    except (TypeError, ValueError) as error:
        raise EvalkitError(f"{name}: vertices and triangles must be arrays of numbers") from error
    if v.ndim != 2 or v.shape[1:] != (3,) or not len(v):
        raise EvalkitError(f"{name}: vertices have shape {v.shape}; expected (V, 3)")
    if t.ndim != 2 or t.shape[1:] != (3,) or not len(t) or not np.issubdtype(t.dtype, np.integer):
        raise EvalkitError(f"{name}: triangles have shape {t.shape} and type {t.dtype}; expected (T, 3) of integers")
    bad = np.flatnonzero(~np.isfinite(v).all(axis=1))
    if len(bad):
        raise EvalkitError(f"{name}: vertex {bad[0]} is not finite ({len(bad)} such); mend the mesh")
    bad = np.flatnonzero(((t < 0) | (t >= len(v))).any(axis=1))
    if len(bad):
        raise EvalkitError(f"{name}: triangle {bad[0]} has vertices {t[bad[0]].tolist()}, of {len(v)}")
    t = t.astype(np.intp)
    bad = np.flatnonzero(without_area(v, t))
    if len(bad):
        raise EvalkitError(
            f"{name}: triangle {bad[0]} ({', '.join(map(str, t[bad[0]]))}) has no area ({len(bad)} such); remove it"
        )
    return v, t


def checked_shapes(shapes: ArrayLike, vertices: int, name: str) -> Array:
    """Shapes of one topology, (N, V, 3).

    Raises
    ------
    EvalkitError
        If the number of vertices differs or a position is not finite; with the number of shape and vertex.
    """
    try:
        out = np.asarray(shapes, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise EvalkitError(
            f"{name}: shapes differ in their number of vertices; the rest mesh has {vertices}"
        ) from error
    if out.ndim != 3 or out.shape[1:] != (vertices, 3):
        raise EvalkitError(f"{name}: shape {out.shape}; expected (shapes, {vertices}, 3) as the rest mesh has")
    bad = np.argwhere(~np.isfinite(out).all(axis=2))
    if len(bad):
        raise EvalkitError(f"{name}: shape {bad[0, 0]}: vertex {bad[0, 1]} is not finite ({len(bad)} such)")
    return out


def without_area(vertices: Array, triangles: Indices) -> NDArray[np.bool_]:
    """Triangles that have no direction across them, (..., V, 3) to (..., T)."""
    a, b, c = (vertices[..., triangles[:, k], :] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1)
    size = np.linalg.norm(np.ptp(vertices, axis=-2), axis=-1)
    return np.asarray(area <= FLAT * size[..., None] ** 2)


def mesh_size(vertices: Array) -> float:
    """Diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def edge_frames(vertices: Array, triangles: Indices) -> Array:
    """Two edges of each triangle and its normal, scaled like an edge, as columns.

    The third column is ``c / sqrt(|c|)`` with ``c = e1 x e2``: it grows with the edges, so that the gradient of a mesh
    that is scaled by s is s in every direction. (A unit normal would give 1 across, ``c`` itself s squared.)

    Parameters
    ----------
    vertices : ndarray, shape (..., V, 3)
    triangles : ndarray of int, shape (T, 3)

    Returns
    -------
    ndarray, shape (3, 3, ..., T)

    References
    ----------
    Sumner and Popovic, "Deformation transfer for triangle meshes", SIGGRAPH 2004, doi:10.1145/1015706.1015736, eq. 1.
    """
    places = np.ascontiguousarray(np.moveaxis(vertices, -1, 0))
    first, second, third = (np.take(places, corner, axis=-1) for corner in triangles.T)
    out = np.empty((3, 3, *first.shape[1:]))
    a, b, c = out[:, 0], out[:, 1], out[:, 2]
    np.subtract(second, first, out=a)
    np.subtract(third, first, out=b)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        c[i] = a[j] * b[k] - a[k] * b[j]
    length = np.sqrt(c[0] ** 2 + c[1] ** 2 + c[2] ** 2)
    # A triangle of a shape may collapse to a line; its normal is then zero, not undefined.
    c /= np.sqrt(np.where(length > 0.0, length, 1.0))
    return out


def deformation_gradients(rest: Array, shapes: Array, triangles: Indices) -> Array:
    """Linear maps G with ``G edge_frame(rest) = edge_frame(shape)`` for every triangle.

    Parameters
    ----------
    rest : ndarray, shape (V, 3)
    shapes : ndarray, shape (..., V, 3)
    triangles : ndarray of int, shape (T, 3)

    Returns
    -------
    ndarray, shape (3, 3, ..., T)
    """
    base = inverse(edge_frames(rest, triangles))
    frames = edge_frames(shapes, triangles)
    return product(frames, base.reshape(3, 3, *(1,) * (frames.ndim - 3), -1))


def flipped(rest: Array, shapes: Array, triangles: Indices) -> NDArray[np.bool_]:
    """Triangles that have turned over: their normal points against the rotation of what surrounds them.

    A triangle alone cannot tell: its gradient's fourth edge goes along. Where the normal of a triangle makes an
    obtuse angle with the mean normal, over its three vertices, of the shape, and did not at rest, it is flipped.

    Parameters
    ----------
    rest : ndarray, shape (V, 3)
    shapes : ndarray, shape (N, V, 3)
    triangles : ndarray of int, shape (T, 3)

    Returns
    -------
    ndarray of bool, shape (N, T)
    """

    def against(vertices: Array) -> NDArray[np.bool_]:
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        around = np.zeros_like(vertices)
        for k in range(3):
            np.add.at(around, triangles[:, k], normal)
        return np.asarray(np.einsum("ti,tki->t", normal, around[triangles]) < 0.0)

    before = against(rest)
    return np.array([against(shape) & ~before for shape in shapes]).reshape(len(shapes), len(triangles))
