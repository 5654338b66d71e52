"""Our variant: what the examples say about a place, weighted by how alike the motion around that place is.

Every vertex has a gain, learned around it from all examples, and on top of it the differences that gains leave,
regressed on the rough motion in a window along the surface. Where nothing alike was sculpted the second part fades
out, and the gain itself stays near one where the examples hardly move: a shape is never changed by examples that have
nothing to do with it. The method of the paper has no such way back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evalkit.geometry import Array
from evalkit.transfer.gradients import Indices, mesh_size

CENTRES = 200
"""Places at which weights are found; in between they are interpolated."""

GAIN_WIDTH = 0.1
"""Standard deviation of the windows of the gain, along the surface, over the root of the area that examples move. The
kernels have widths of their own."""

OVERLAP = 0.8
"""Standard deviation of the interpolation between centres, over their distance from one another."""

GAIN_PRIOR = 0.1
"""Weight of the gain of the whole face against that of a window, over the typical energy of the examples."""

EXPLAINED_RIDGE = 1e-2
"""Ridge of the mixtures that explain a motion, over the mean energy of the examples in a window."""

WHOLE_PRIOR = 3.0
"""The gain of the whole face is held to one as if by so many more examples that nobody changed."""

FLOOR = 1e-3
"""Motion in a window with less energy, over the typical energy, is not like anything."""

STILL = 1e-4
"""A vertex that no example moves by more than this share of the mesh's diagonal counts as still."""

MIRROR = 0.25
"""A mesh is symmetric if every vertex has another this near to its mirror image, over the median length of edges."""

LEAST_SHARE = 1e-3
"""Kernels that count for less are left out."""

CHECKED = 1000
"""Vertices, about, on which left-out examples are predicted."""


class Kernel(NamedTuple):
    """``|x| |x'| exp((cos(x, x') - 1) / tau)`` in windows of a width, with a ridge.

    Mirrored: examples count mirrored, too. Gated: weights are multiplied by the share of the motion that mixtures of
    the examples reproduce, without which a nearly linear kernel changes what nothing was learned about.
    """

    tau: float
    ridge: float
    width: float
    mirrored: bool
    gated: bool


KERNELS = (
    Kernel(0.15, 0.1, 0.2, True, False),
    Kernel(1.0, 0.1, 0.1, True, True),
    Kernel(1.0, 0.1, 0.1, False, True),
    Kernel(10.0, 0.001, 0.1, True, True),
    Kernel(10.0, 0.001, 0.1, False, True),
)
"""From the one that trusts nearly equal motions only to nearly linear ones. How much each counts is told by leaving out
one example after the other. Chosen on two_artists("ict to makehuman"), template and muzzle: with random examples of
seeds that the studies do not have, and with the four examples that the last two come with."""


@dataclass(frozen=True, eq=False)
class Windows:
    """Overlapping windows along the surface.

    Attributes
    ----------
    distance : ndarray, shape (C, V)
        From the centres along edges; infinite on other connected parts.
    size : float
        Root of the area that the windows are to cover.
    between : ndarray, shape (C, V)
        Weights that interpolate from centres to vertices; they sum to one.
    """

    distance: Array
    size: float
    between: Array

    @classmethod
    def over(cls, rest: Array, triangles: Indices, moving: NDArray[np.bool_]) -> Windows:
        """Windows that cover the moving vertices (V,)."""
        from scipy.sparse.csgraph import dijkstra
        from scipy.spatial import cKDTree

        from evalkit.deform.surface import edge_graph, spread_out

        which = np.flatnonzero(moving) if moving.any() else np.arange(len(rest))
        centres = which[spread_out(rest[which], CENTRES)]
        distance = dijkstra(edge_graph(rest, triangles), directed=False, indices=centres)
        a, b, c = (rest[triangles[:, k]] for k in range(3))
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        covered = np.isin(triangles, which).any(axis=1)
        apart = np.sort(distance[:, centres], axis=1)[:, min(1, len(centres) - 1)]
        width = OVERLAP * float(np.median(apart[np.isfinite(apart)])) or 1.0
        # The nearest centre's own weight is one before they are made to sum to one: none are lost far from all.
        nearest = distance.min(axis=0)
        reached = np.isfinite(nearest)
        off = distance**2 - np.where(reached, nearest, 0.0) ** 2
        between = np.where(np.isfinite(distance), np.exp(-0.5 * np.where(np.isfinite(off), off, 0.0) / width**2), 0.0)
        if not reached.all():
            near = cKDTree(rest[reached]).query(rest[~reached])[1]
            between[:, ~reached] = between[:, np.flatnonzero(reached)[near]]
        return cls(distance, float(np.sqrt(area[covered].sum())), between / between.sum(axis=0))

    def weights(self, width: float) -> Array:
        """Weights (C, V) of windows that sum to one over the vertices; ``width`` is a share of the size."""
        out = np.exp(-0.5 * (self.distance / (width * self.size)) ** 2)
        return np.asarray(out / out.sum(axis=1, keepdims=True))

    def products(self, a: Array, b: Array, weights: Array) -> Array:
        """Scalar products (C, K, L) of displacement fields (K, V, 3) and (L, V, 3) in every window."""
        pairs = np.einsum("kvi,lvi->klv", a, b, optimize=True)
        return np.asarray((weights @ pairs.reshape(-1, a.shape[1]).T).reshape(-1, len(a), len(b)))


def mirror_image(rest: Array, triangles: Indices) -> Indices | None:
    """The vertex (V,) at the mirror image of each about the plane through the middle of the mesh across x.

    None if the mesh is not symmetric.
    """
    from scipy.spatial import cKDTree

    image = rest * [-1.0, 1.0, 1.0] + [rest[:, 0].min() + rest[:, 0].max(), 0.0, 0.0]
    off, found = cKDTree(rest).query(image)
    edge = np.median(np.linalg.norm(rest[triangles[:, 0]] - rest[triangles[:, 1]], axis=1))
    return np.asarray(found) if off.max() <= MIRROR * edge else None


class LocalRegression:
    """The mapping from rough to fine, regressed on local motion.

    At a vertex, with displacement x of the rough shape, ``y = g x + sum_k w_k (y_k - g x_k)``. The gain g is least
    squares over the examples and a window, held to that of the whole face, which is held to one. The weights w are
    those of kernel ridge regression on the motion in a window, with kernels that are homogeneous: half an expression
    gets half the change. Examples of a symmetric mesh count mirrored, too. Several kernels are weighed by ``E^-M``,
    E the squared error when each of the M examples, with its mirror image, is predicted by the others.

    Parameters
    ----------
    rest : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    rough, fine : ndarray, shape (M, V, 3)
        Examples.

    Attributes
    ----------
    shares : ndarray, shape (kernels,)
        Weight of every kernel.

    References
    ----------
    Rasmussen and Williams, "Gaussian Processes for Machine Learning", MIT Press 2006, chapters 2 and 5.4.2.
    """

    def __init__(self, rest: Array, triangles: Indices, rough: Array, fine: Array) -> None:
        self.rest = rest
        x, y = rough - rest, fine - rest
        count = self._count = len(x)
        moving = np.abs(np.concatenate([x, y])).max(axis=(0, 2)) > STILL * mesh_size(rest)
        self._windows = Windows.over(rest, triangles, moving)
        energy = (x**2).sum(axis=2)
        self._typical = float((energy**2).sum() / total) if (total := float(energy.sum())) > 0.0 else 1.0
        image = mirror_image(rest, triangles)
        if image is not None:
            x, y = (np.concatenate([z, z[:, image] * [-1.0, 1.0, 1.0]]) for z in (x, y))
        self._x = x
        self._gain, self._left = self._gained(x, y)
        # Kernels that are narrower in angle share the products of their windows.
        self._window = {width: self._windows.weights(width) for width in {kernel.width for kernel in KERNELS}}
        self._gram = {width: self._windows.products(x, x, window) for width, window in self._window.items()}
        errors = self._left_out(count)
        scaled = errors / errors.min() if errors.min() > 0.0 else np.where(errors > 0.0, np.inf, 1.0)
        shares = scaled ** -float(count)
        self.shares = shares / shares.sum()

    def _gained(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Gain (V, 1) of every vertex, and what it leaves of the examples (M, V, 3)."""
        prior = WHOLE_PRIOR * float((x**2).sum()) / len(x)
        both, own = (x * y).sum(axis=(0, 2)), (x**2).sum(axis=(0, 2))
        whole = (both.sum() + prior) / (own.sum() + prior) if prior > 0.0 else 1.0
        hold = GAIN_PRIOR * self._typical
        window = self._windows.weights(GAIN_WIDTH)
        at = (window @ both + hold * whole) / (window @ own + hold)
        gain = (at @ self._windows.between)[:, None]
        return gain, y - gain * x

    def _weights(self, kernel: Kernel, gram: Array, cross: Array, own: Array) -> Array:
        """Weights (C, M, N) of examples with products (C, M, M), for shapes with products (C, M, N), norms (C, N)."""
        floor = FLOOR * self._typical
        size, new = np.sqrt(np.einsum("ckk->ck", gram) + floor), np.sqrt(own + floor)
        cosine = gram / (size[:, :, None] * size[:, None])
        like = np.exp((cross / (size[:, :, None] * new[:, None]) - 1.0) / kernel.tau)
        matrix = np.exp((cosine - 1.0) / kernel.tau) + kernel.ridge * np.eye(gram.shape[1])
        found = np.linalg.solve(matrix, like)
        if kernel.gated:
            found *= self._explained(gram, cross, own)[:, None]
        # Not the floored size: what does not move must stay.
        return np.asarray(found * np.sqrt(own)[:, None] / size[:, :, None])

    def _explained(self, gram: Array, cross: Array, own: Array) -> Array:
        """Share (C, N) of the energy of shapes that mixtures of the examples' rough motion reproduce in each window."""
        count = gram.shape[1]
        hold = EXPLAINED_RIDGE * np.einsum("ckk->c", gram) / count + FLOOR * self._typical
        mixed = np.linalg.solve(gram + hold[:, None, None] * np.eye(count), cross)
        return np.asarray(np.clip(np.einsum("ckn,ckn->cn", cross, mixed) / (own + FLOOR * self._typical), 0.0, 1.0))

    def _left_out(self, count: int) -> Array:
        """Squared error of every kernel when each of the first examples, with its mirror image, is left out in turn.

        The gain stays that of all examples. One example alone speaks for nothing but the first kernel.
        """
        if count < 2:
            return np.where(np.arange(len(KERNELS)) == 0, 1.0, np.inf)
        out = np.zeros(len(KERNELS))
        some = np.arange(0, self._x.shape[1], max(1, self._x.shape[1] // CHECKED))
        left, between = self._left[:, some], self._windows.between[:, some]
        rows = np.arange(len(self._x))
        for number, kernel in enumerate(KERNELS):
            gram = self._gram[kernel.width]
            for k in range(count):
                others = np.flatnonzero((rows % count != k) & (kernel.mirrored | (rows < count)))
                parts = gram[:, others][:, :, others], gram[:, others, k : k + 1], gram[:, k, k : k + 1]
                weights = self._weights(kernel, *parts)[:, :, 0]
                out[number] += float(((_summed(weights, between, left[others]) - left[k]) ** 2).sum())
        return out

    def __call__(self, new: Array) -> Array:
        """Fine shapes for rough ones, (N, V, 3)."""
        x = new - self.rest
        energy = (x**2).sum(axis=2).T
        weights = np.zeros((len(self._windows.between), len(self._x), len(x)))
        for share, kernel in zip(self.shares, KERNELS, strict=True):
            if share < LEAST_SHARE:
                continue
            window, gram = self._window[kernel.width], self._gram[kernel.width]
            rows = slice(None) if kernel.mirrored else slice(self._count)
            cross = self._windows.products(self._x[rows], x, window)
            weights[:, rows] += share * self._weights(kernel, gram[:, rows, rows], cross, window @ energy)
        out = self.rest + self._gain * x
        for n in range(len(x)):
            out[n] += _summed(weights[:, :, n], self._windows.between, self._left)
        return np.asarray(out)


def _summed(weights: Array, between: Array, fields: Array) -> Array:
    """Fields (M, V, 3) summed (V, 3) with weights (C, M) that are interpolated from the centres to the vertices."""
    return np.asarray(np.einsum("mv,mvi->vi", weights.T @ between, fields))
