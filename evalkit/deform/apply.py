"""Playing a deformation map: one matrix product per batch of frames, into buffers that are used again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

BATCH = 32
"""Frames per product: with fewer, reading the map takes longer than using it."""

BLOCK = 5_000
"""Vertices per product: with a batch of frames the result stays in the processor's cache."""


class Deformer:
    """A deformation map made ready for frames.

    The product is taken as ``(3 f, n) @ (n, V)``, one row per frame and axis, which is the shape at which a matrix
    product is fast; positions are seen through a transposed view of it. The rest pose takes part as three more
    columns of the map, so that adding it costs no second pass over the result.

    Parameters
    ----------
    weights : array_like, shape (V, n)
        From :func:`~evalkit.deform.deformation_map`.
    rest : array_like, shape (V, 3), mm, optional
        Rest pose; with it the result is positions, without it displacements.
    dtype : dtype
        float32 is twice as fast and what a renderer takes; over a face its positions are within 1e-4 mm of those
        of float64.

    Raises
    ------
    EvalkitError
        If the shapes do not fit.
    """

    def __init__(self, weights: ArrayLike, rest: ArrayLike | None = None, dtype: DTypeLike = np.float64) -> None:
        w = np.asarray(weights)
        if w.ndim != 2:
            raise EvalkitError(f"weights have shape {w.shape}; expected (vertices, centres)")
        self.vertices, self.centres = w.shape
        parts = [w.T]
        if rest is not None:
            pose = np.asarray(rest)
            if pose.shape != (self.vertices, 3):
                raise EvalkitError(f"rest pose has shape {pose.shape}; expected ({self.vertices}, 3)")
            parts.append(pose.T)
        self._map = np.ascontiguousarray(np.concatenate(parts), dtype=dtype)
        self._columns = np.empty((BATCH, 3, len(self._map)), dtype=dtype)
        self._columns[:, :, self.centres :] = np.eye(3)[:, : len(self._map) - self.centres]
        self._result = np.empty((BATCH, 3, self.vertices), dtype=dtype)

    def __call__(self, displacement: ArrayLike) -> Array:
        """Deform all frames.

        Parameters
        ----------
        displacement : array_like, shape (F, n, 3) or (n, 3), mm
            Displacements of the centres from their rest positions. A frame with a missing marker (NaN) comes out
            as NaN: its vertices are not known. :func:`~evalkit.deform.fill_missing` estimates them.

        Returns
        -------
        ndarray, shape (F, V, 3) or (V, 3), mm
        """
        u = np.asarray(displacement)
        frames = u[None] if u.ndim == 2 else u
        self._check(frames)
        out = np.empty((len(frames), 3, self.vertices), dtype=self._map.dtype)
        for start in range(0, len(frames), BATCH):
            self._deform(frames[start : start + BATCH], out[start : start + BATCH])
        positions = out.transpose(0, 2, 1)
        return positions[0] if u.ndim == 2 else positions

    def batches(self, displacement: ArrayLike) -> Iterator[tuple[int, Array]]:
        """First frame and positions (f, V, 3) of one batch after the other.

        Every batch is written over the one before, so a take of any length needs no more memory than one batch.
        """
        frames = np.asarray(displacement)
        self._check(frames)
        for start in range(0, len(frames), BATCH):
            part = frames[start : start + BATCH]
            yield start, self._deform(part, self._result[: len(part)]).transpose(0, 2, 1)

    def _check(self, frames: np.ndarray) -> None:
        if frames.ndim != 3 or frames.shape[1:] != (self.centres, 3):
            raise EvalkitError(f"displacements have shape {frames.shape}; expected (frames, {self.centres}, 3)")

    def _deform(self, frames: np.ndarray, out: Array) -> Array:
        columns = self._columns[: len(frames)]
        columns[:, :, : self.centres] = frames.transpose(0, 2, 1)
        rows = len(frames) * 3
        left, result = columns.reshape(rows, -1), out.reshape(rows, -1)
        for first in range(0, self.vertices, BLOCK):
            block = slice(first, first + BLOCK)
            np.matmul(left, self._map[:, block], out=result[:, block])
        return out
