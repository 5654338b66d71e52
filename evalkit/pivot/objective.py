"""The paper's objective for the pivot, Eq. (5), and its smooth squared variant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.pose.reference import Reference, check_reference


@dataclass(frozen=True, eq=False)
class Objective:
    """How much the angles and lengths of the rigid markers, seen from a candidate pivot, vary over the frames.

    ``E(O) = w1 sum_ij |theta_ij - theta_ref,j| l + w2 sum_ij |l_ij - l_ref,j| + w3 |O - origin| / C``, where
    theta_ij is the angle at O between markers j and j+1 (cyclic) of frame i and l_ij the distance of marker j.

    Attributes
    ----------
    points : ndarray, shape (F, M, 3), mm
        Rigid markers, NaN where missing: their terms are left out.
    reference : "mean", "median" or int
        What the angles and lengths are compared with. The paper's is a frame, whose own noise then enters
        every term.
    angle_weight, length_weight, pull_weight : float
        w1, w2, w3.
    length_scale_mm, pull_scale_mm : float
        l and C.
    origin : ndarray, shape (3,), mm
        What the third term pulls towards: the paper's local origin, put near the pivot beforehand.

    References
    ----------
    Huang, Lin & Ouhyoung (2000), Eq. (5), indices read as: every frame i, every rigid marker j.
    """

    points: Array
    reference: Reference
    origin: Array
    angle_weight: float = 1.0
    length_weight: float = 1.0
    pull_weight: float = 1.0
    length_scale_mm: float = 100.0
    pull_scale_mm: float = 100.0

    def __post_init__(self) -> None:
        check_reference(self.reference, len(self.points))
        if self.points.shape[1] < 2:
            raise EvalkitError("the angle term needs at least two rigid markers")

    def _about(self, values: Array, mean: str) -> Array:
        """Differences of (..., F, M) values to the reference over frames."""
        if not isinstance(self.reference, str):
            return values - values[..., self.reference, None, :]
        seen = np.isfinite(values)
        if mean == "median":
            # Two neighbours that are never seen together have no angle, and no median of it.
            known = np.where(seen.any(axis=-2, keepdims=True), values, 0.0)
            return values - np.nanmedian(known, axis=-2, keepdims=True)
        if seen.all():
            return values - values.mean(axis=-2, keepdims=True)
        count = np.maximum(seen.sum(axis=-2, keepdims=True), 1)
        return values - np.where(seen, values, 0.0).sum(axis=-2, keepdims=True) / count

    def _shape(self, candidates: Array) -> tuple[Array, Array, Array, Array]:
        """Arms (K, F, M, 3), lengths (K, F, M), cosines and angles between neighbours (K, F, M)."""
        arm = self.points - candidates[:, None, None, :]
        length = np.sqrt(np.einsum("kfmi,kfmi->kfm", arm, arm))
        after = np.roll(arm, -1, axis=2)
        cosine = np.einsum("kfmi,kfmi->kfm", arm, after) / np.maximum(length * np.roll(length, -1, axis=2), 1e-300)
        cosine = np.clip(cosine, -1.0, 1.0)
        return arm, length, cosine, np.arccos(cosine)

    def __call__(self, candidates: Array) -> Array:
        """Value of Eq. (5) for candidate pivots (K, 3), mm; shape (K,)."""
        _, length, _, angle = self._shape(candidates)
        how = self.reference if isinstance(self.reference, str) else ""
        total = self.pull_weight / self.pull_scale_mm * np.linalg.norm(candidates - self.origin, axis=1)
        if self.angle_weight:
            weight = self.angle_weight * self.length_scale_mm
            total = total + weight * np.nansum(np.abs(self._about(angle, how)), axis=(1, 2))
        if self.length_weight:
            total = total + self.length_weight * np.nansum(np.abs(self._about(length, how)), axis=(1, 2))
        return total

    def squared(self, candidate: Array) -> tuple[float, Array]:
        """The squared variant at one candidate (3,), with its gradient (3,): every ``|.|`` becomes its square.

        ``median`` has no derivative and is taken as ``mean`` here.
        """
        arm, length, cosine, angle = (a[0] for a in self._shape(candidate[None]))
        pull = (candidate - self.origin) / self.pull_scale_mm
        value = self.pull_weight * float(pull @ pull)
        gradient = 2.0 * self.pull_weight / self.pull_scale_mm * pull
        if self.length_weight:
            slope = -arm / np.maximum(length, 1e-300)[:, :, None]
            value, gradient = self._add(value, gradient, self.length_weight, length, slope)
        if self.angle_weight:
            after, other = np.roll(arm, -1, axis=1), np.roll(length, -1, axis=1)
            sine = np.sqrt(np.maximum(1.0 - cosine**2, 1e-18))
            product = np.maximum(length * other, 1e-300)
            of_cosine = (
                -(arm + after) / product[:, :, None]
                + (cosine / np.maximum(length**2, 1e-300))[:, :, None] * arm
                + (cosine / np.maximum(other**2, 1e-300))[:, :, None] * after
            )
            slope = -of_cosine / sine[:, :, None]
            weight = self.angle_weight * self.length_scale_mm**2
            value, gradient = self._add(value, gradient, weight, angle, slope)
        return value, gradient

    def _add(self, value: float, gradient: Array, weight: float, terms: Array, slope: Array) -> tuple[float, Array]:
        about = np.nan_to_num(self._about(terms, "mean"))
        inner = np.nan_to_num(slope)
        if isinstance(self.reference, str):
            # The mean's own derivative drops out: residuals about a mean sum to zero.
            change = np.einsum("fm,fmi->i", about, inner)
        else:
            change = np.einsum("fm,fmi->i", about, inner) - about.sum(axis=0) @ inner[self.reference]
        return value + weight * float((about**2).sum()), gradient + 2.0 * weight * change
