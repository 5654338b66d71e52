"""Mappings of examples blended per triangle, without collapsing or turning triangles over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evalkit.geometry import Array
from evalkit.transfer.matrices import exp_rotation, exp_symmetric, log_positive, log_rotation, polar, product

LEAST_STRETCH = 1e-6
"""A triangle that an example squeezes to less is taken to be squeezed so far."""


@dataclass(frozen=True, eq=False)
class RotationStretch:
    """Mappings ``Q = R S`` by their logarithms: ``Q(w) = exp(sum w_k log R_k) exp(sum w_k log S_k)``.

    For one example the rotation is the paper's spherical interpolation from the identity. The determinant is positive
    for any coefficients. Rotations and stretches go no further than the strongest example of each triangle has them:
    what lies beyond would grow exponentially, and where lids fold, one example may stretch a triangle by hundreds.

    Attributes
    ----------
    logs : ndarray, shape (M, 9, T)
        Rotation vectors, then the upper triangle of log S row by row.
    most : ndarray, shape (2, T)
        Largest angle, and largest norm of log S, of the examples.

    References
    ----------
    Kato et al. 2014, section 3.4, eq. 8 to 10; Kaji et al., SCA 2012.
    """

    logs: Array
    most: Array

    @classmethod
    def of(cls, mappings: Array) -> RotationStretch:
        """From mappings (3, 3, M, T).

        A mapping with a negative determinant, of an example in which a triangle has turned over, has no such logarithm:
        the negative stretch counts as its size.
        """
        # One example at a time: what it needs stays in the processor's cache.
        logs = np.stack([_logarithms(mappings[:, :, k]) for k in range(mappings.shape[2])])
        return cls(logs, np.stack([_norm(part).max(axis=0) for part in (logs[:, :3], logs[:, 3:])]))

    def blended(self, weights: Array) -> Array:
        """Mappings (3, 3, N, T) for coefficients (N, M, T)."""
        log = _combined(weights, self.logs)
        for part, most in zip((log[:3], log[3:]), self.most, strict=True):
            length = _norm(part.swapaxes(0, 1))
            part *= np.minimum(1.0, most / np.where(length > 0.0, length, 1.0))
        symmetric = log[3:][[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3, *log.shape[1:])
        return product(exp_rotation(log[:3]), exp_symmetric(symmetric))


def _norm(log: Array) -> Array:
    """Norms of vectors (..., 3, T), or of symmetric matrices by their upper triangles (..., 6, T)."""
    out = np.einsum("...kt,...kt->...t", log, log)
    if log.shape[-2] == 6:
        off = log[..., [1, 2, 4], :]
        out += np.einsum("...kt,...kt->...t", off, off)
    return np.asarray(np.sqrt(out))


def _logarithms(mappings: Array) -> Array:
    """Rotation vectors and the upper triangle of log S (9, T) of mappings (3, 3, T)."""
    rotation, stretch = polar(mappings)
    logs = log_positive(stretch)
    # No eigenvalue is larger than three times the largest entry: all that are squeezed too far are among these.
    bad = ~(np.abs(logs).max(axis=(0, 1)) < -np.log(LEAST_STRETCH) / 3.0)
    if bad.any():
        values, vectors = np.linalg.eigh(stretch[:, :, bad].transpose(2, 0, 1))
        values = np.log(np.maximum(np.abs(values), LEAST_STRETCH))
        logs[:, :, bad] = (vectors * values[:, None] @ vectors.transpose(0, 2, 1)).transpose(1, 2, 0)
    return np.concatenate([log_rotation(rotation), logs[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]])


@dataclass(frozen=True, eq=False)
class Linear:
    """Mappings blended entry by entry, ``Q(w) = 1 + sum w_k (Q_k - 1)``: the baseline that collapses and turns over.

    Attributes
    ----------
    moves : ndarray, shape (M, 9, T)
        ``Q_k - 1``.
    """

    moves: Array

    @classmethod
    def of(cls, mappings: Array) -> Linear:
        """From mappings (3, 3, M, T)."""
        off = (mappings - np.eye(3)[:, :, None, None]).reshape(9, *mappings.shape[2:])
        return cls(np.ascontiguousarray(off.transpose(1, 0, 2)))

    def blended(self, weights: Array) -> Array:
        """Mappings (3, 3, N, T) for coefficients (N, M, T)."""
        moves = _combined(weights, self.moves)
        return np.asarray(moves.reshape(3, 3, *moves.shape[1:]) + np.eye(3)[:, :, None, None])


def _combined(weights: Array, entries: Array) -> Array:
    """Sums over the examples (K, N, T) of coefficients (N, M, T) times entries (M, K, T)."""
    out = np.zeros((entries.shape[1], len(weights), entries.shape[2]))
    part = np.empty_like(out)
    # A loop over the few examples: einsum takes four times as long over three indices.
    for weight, entry in zip(weights.swapaxes(0, 1), entries, strict=True):
        out += np.multiply(weight, entry[:, None], out=part)
    return out


blends: dict[str, type[RotationStretch | Linear]] = {"rotation-stretch": RotationStretch, "linear": Linear}
"""Ways to blend, name to class."""
