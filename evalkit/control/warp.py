"""Volume warps: a map of all of space from places on one head to the same places on another, with its Jacobian."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evalkit.deform.interpolation import rbf
from evalkit.deform.kernels import OWN, euclidean
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, blocks

SLOPES: dict[str, Callable[[Array], Array]] = {
    "exponential": lambda r: -np.exp(-r),
    "gaussian": lambda r: -2.0 * r * np.exp(-(r**2)),
    "multiquadric": lambda r: r / np.sqrt(1.0 + r**2),
    "inverse-multiquadric": lambda r: -r * (1.0 + r**2) ** -1.5,
    "thin-plate": lambda r: r * (2.0 * np.log(np.where(r > 0.0, r, 1.0)) + 1.0),
    "biharmonic": np.ones_like,
    "cubic": lambda r: 3.0 * r**2,
    "wendland-c2": lambda r: -20.0 * r * np.maximum(1.0 - r, 0.0) ** 3,
    "matern-3-2": lambda r: -3.0 * r * np.exp(-np.sqrt(3.0) * r),
    "matern-5-2": lambda r: -(5.0 / 3.0) * r * (1.0 + np.sqrt(5.0) * r) * np.exp(-np.sqrt(5.0) * r),
}
"""Kernel of :data:`evalkit.kernels` -> derivative of its radial function."""

DEFAULT = "rounded biharmonic"

WARP_KERNELS: dict[str, tuple[str, float | None]] = {
    DEFAULT: ("multiquadric", 0.1),
    **{name: (name, OWN[name].scale) for name in SLOPES},
}
"""Name -> kernel that a warp can be made of, and its scale, as a fraction of the spread of the places.

The biharmonic kernel bends least, and has a kink at each landmark across which the Jacobian jumps: a lip that is pulled
at its middle gets a spike there. A multiquadric of 6 mm is the same beyond, without the kink.
"""

BLOCK = 4096
"""Points at once: their distances to 400 centres take 13 MB."""

NAMED = 3
"""So many places are named where a warp folds."""


@dataclass(frozen=True, eq=False)
class Warp:
    """``f(x) = A x + t + sum_k c_k phi(|x - p_k| / s)``.

    Attributes
    ----------
    kernel : str
        One of :data:`SLOPES`.
    centres : ndarray, shape (N, 3), mm
        Places p_k on the source.
    scale_mm : float
        Length s.
    coefficients : ndarray, shape (N, 3), mm
    matrix : ndarray, shape (3, 3)
        A.
    shift : ndarray, shape (3,), mm
    """

    kernel: str
    centres: Array
    scale_mm: float
    coefficients: Array
    matrix: Array
    shift: Array

    def __call__(self, points: Array) -> Array:
        """Where points (K, 3), mm, go."""
        out = points @ self.matrix.T + self.shift
        phi = OWN[self.kernel].phi
        assert phi is not None
        for part in blocks(len(points), BLOCK):
            out[part] += phi(euclidean(points[part], self.centres) / self.scale_mm) @ self.coefficients
        return np.asarray(out)

    def jacobian(self, points: Array) -> Array:
        """``J = A + sum_k c_k phi'(r_k) / s ((x - p_k) / |x - p_k|)'`` at points (K, 3); shape (K, 3, 3).

        Where a kernel has a kink, at its own centre, the mean over all directions stands for it: its term is zero.
        """
        out = np.empty((len(points), 3, 3))
        for part in blocks(len(points), BLOCK):
            arm = points[part, None] - self.centres
            length = np.sqrt((arm**2).sum(axis=2))
            size = SLOPES[self.kernel](length / self.scale_mm) / self.scale_mm
            size = np.where(length > 0.0, size / np.where(length > 0.0, length, 1.0), 0.0)
            out[part] = self.matrix + np.einsum("ki,nkj->nij", self.coefficients, size[..., None] * arm, optimize=True)
        return out


def fit_warp(source: Mapping[str, Array], target: Mapping[str, Array], kernel: str = DEFAULT) -> Warp:
    """The warp that takes places of one head to those of the same name on another, exactly.

    Lengths are measured by the root mean square distance of the places from their middle, which on a face is about
    the distance between the eyes that the kernels' own scales refer to.

    Parameters
    ----------
    source, target : mapping of str to ndarray, shape (3,), mm
        Names that only one of them has are left out.
    kernel : str
        One of :data:`WARP_KERNELS`.

    Returns
    -------
    Warp

    Raises
    ------
    EvalkitError
        If the kernel has no derivative here, or the places do not span space.

    References
    ----------
    Noh and Neumann, "Expression cloning", SIGGRAPH 2001, doi:10.1145/383259.383290; the interpolant:
    :func:`evalkit.deform.interpolation.rbf`.
    """
    if kernel not in WARP_KERNELS:
        near = difflib.get_close_matches(kernel, WARP_KERNELS, n=2, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(WARP_KERNELS)}"
        raise EvalkitError(f"kernel '{kernel}' makes no warp of space with a derivative; {hint}")
    names = [name for name in source if name in target]
    at, to = (np.array([where[name] for name in names], dtype=np.float64).reshape(-1, 3) for where in (source, target))
    for points, whose in ((at, "source"), (to, "target")):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) if len(points) > 3 else np.zeros(3)
        # Depth over a face is a third of its height: below a hundredth it is a drawing, and depth cannot be learnt.
        if not spread[2] > 0.01 * spread[0]:
            raise EvalkitError(f"the {len(names)} places of the same name lie in one plane on the {whose}; add others")
    middle = at.mean(axis=0)
    unit = float(np.sqrt(((at - middle) ** 2).sum(axis=1).mean()))
    base, scale = WARP_KERNELS[kernel]
    entry, length = OWN[base], unit * (scale or 1.0)
    among = entry.phi(euclidean(at, at) / length)  # type: ignore[misc]
    count = len(at)
    # An interpolant is linear in phi and in the polynomials: asked at a unit vector of each, it gives its coefficients.
    # Its lengths are in units here, as rbf judges by their spread what is flat.
    probes = np.zeros((count + 4, 3))
    probes[count + 1 :] = np.eye(3)
    asked = rbf(among, np.eye(count + 4, count), (at - middle) / unit, probes, entry.degree).weights @ to
    constant = asked[count]
    matrix = (asked[count + 1 :] - constant).T / unit
    return Warp(base, at, length, asked[:count] - constant, matrix, constant - matrix @ middle)


@dataclass(frozen=True, eq=False)
class Folds:
    """Where a warp turns space inside out.

    Attributes
    ----------
    points : int
        How many were looked at.
    folded : ndarray of bool, shape (points,)
        ``det J <= 0``.
    least : float
        Smallest determinant over that of the warp's affine part.
    text : str
        One line.
    """

    points: int
    folded: NDArray[np.bool_]
    least: float
    text: str


def find_folds(warp: Warp, jacobians: Array, points: Array, places: Mapping[str, Array]) -> Folds:
    """Points (K, 3) of the source whose Jacobian (K, 3, 3) has no positive determinant, by the nearest named places.

    The affine part counts: a warp that mirrors as a whole folds everywhere.
    """
    volume = np.linalg.det(jacobians)
    folded = np.asarray(volume <= 0.0)
    least = float((volume / abs(np.linalg.det(warp.matrix))).min()) if len(points) else 1.0
    if not folded.any():
        return Folds(len(points), folded, least, f"no fold at {len(points)} points; least volume {least:.2f}")
    names = list(places)
    gap = euclidean(points[folded], np.array([places[name] for name in names]))
    near, times = np.unique(gap.argmin(axis=1), return_counts=True)
    where = [f"{names[near[k]]} ({times[k]})" for k in np.argsort(-times, kind="stable")[:NAMED]]
    text = f"folded at {folded.sum()} of {len(points)} points, nearest to {', '.join(where)}; least volume {least:.2f}"
    return Folds(len(points), folded, least, text)
