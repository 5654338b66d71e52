"""A retargeted performance as coefficients of the target's own shapes, for programs that play those.

Shapes that are named after ARKit's are what game engines and animation programs exchange. The coefficients are those of
the nearest mixture; what no mixture of the head's shapes can do is the residual.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from evalkit.control.retargeting import TargetBases
from evalkit.control.targets import IDENTITY
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.model import Indices

RIDGE = 1e-4
"""Weight of the squared coefficients over the mean squared size of a shape: of mixtures that do the same, the smallest
one. A shape of mean size loses a ten-thousandth by it."""

ON_SKIN = 0.5
"""Shapes less of whose squared motion is the skin's turn eyeballs or put the tongue out: markers do not show that."""

CLOSE, STEPS = 1e-7, 4000
"""Steps end when no coefficient changes by more, or after so many."""


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """Coefficients of a head's shapes.

    Attributes
    ----------
    names : tuple of str, length K
        As the head calls them.
    values : ndarray, shape (F, K)
        0 to 1.
    residual_mm, motion_mm : ndarray, shape (F,)
        Root mean square over the skin of what is left, and of the motion itself.
    """

    names: tuple[str, ...]
    values: Array
    residual_mm: Array
    motion_mm: Array

    @property
    def text(self) -> str:
        """One line."""
        left, whole = (float(np.sqrt((mm**2).mean())) for mm in (self.residual_mm, self.motion_mm))
        return (
            f"{len(self.names)} shapes leave {left:.2f} of {whole:.2f} mm of motion, rms over the skin and all frames"
        )

    def save(self, path: str | Path, rate_hz: float) -> None:
        """Write a CSV file, complete or not at all: frame, time_s, a column for each shape, residual_mm.

        Raises
        ------
        EvalkitError
            If the file cannot be written.
        """
        path = Path(path)
        temporary = path.with_name(path.name + ".part")
        try:
            with temporary.open("w", encoding="utf-8", newline="") as file:
                table = csv.writer(file, lineterminator="\n")
                table.writerow(["frame", "time_s", *self.names, "residual_mm"])
                for frame, (row, left) in enumerate(zip(self.values, self.residual_mm, strict=True)):
                    time = f"{frame / rate_hz:.6f}"
                    table.writerow([frame, time, *(f"{value:.5f}" for value in row), f"{left:.4f}"])
            temporary.replace(path)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise EvalkitError(f"{path}: cannot write the coefficients ({error.strerror or error})") from error


def fit_shapes(head: Head, bases: TargetBases, coefficients: ArrayLike) -> ShapeFit:
    """Coefficients of a head's shapes nearest to a performance, ``min |sum_k x_k S_k - u|^2`` with ``0 <= x <= 1``.

    Parameters
    ----------
    head : Head
        With blendshapes; those that make it another person or move mainly eyeballs or tongue do not count.
    bases : TargetBases
        On this head.
    coefficients : array_like, shape (F, L)
        Of the bases.

    Returns
    -------
    ShapeFit

    Raises
    ------
    EvalkitError
        If the head has no shapes, or shapes of arrays do not fit.

    Notes
    -----
    All frames at once, on the normal equations, so that the cost of a frame does not depend on the number of vertices.

    References
    ----------
    Beck and Teboulle, "A fast iterative shrinkage-thresholding algorithm", SIAM J. Imaging Sci. 2(1), 2009,
    doi:10.1137/080716542; restarts: O'Donoghue and Candes, Found. Comput. Math. 15, 2015,
    doi:10.1007/s10208-013-9150-3.
    """
    skin = head.skin_vertices
    names = shape_names(head)
    given = np.asarray(coefficients, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] != len(bases.bases) or bases.rest.shape != head.vertices.shape:
        raise EvalkitError(
            f"coefficients of shape {given.shape} for {len(bases.bases)} bases of {len(bases.rest)} vertices"
        )
    shapes = np.zeros((len(names), *head.vertices.shape))
    for k, name in enumerate(names):
        which, moves = head.blendshapes[name]
        shapes[k, which] = moves
    flat = shapes[:, skin].reshape(len(names), -1)
    moved = bases.bases[:, skin].reshape(len(bases.bases), -1).astype(np.float64)
    gram, right = flat @ flat.T, given @ (moved @ flat.T)
    values = bounded(gram + RIDGE * np.trace(gram) / len(gram) * np.eye(len(gram)), right)
    whole = np.einsum("fi,ij,fj->f", given, moved @ moved.T, given, optimize=True)
    left = whole - 2.0 * (values * right).sum(axis=1) + np.einsum("fi,ij,fj->f", values, gram, values, optimize=True)
    rms = [np.sqrt(np.maximum(squares, 0.0) / len(skin)) for squares in (left, whole)]
    return ShapeFit(names, values, *rms)


def _moves_skin(head: Head, name: str, skin: Indices) -> bool:
    which, moves = head.blendshapes[name]
    squares = (moves**2).sum(axis=1)
    return bool(squares[np.isin(which, skin)].sum() > ON_SKIN * squares.sum())


def shape_names(head: Head) -> tuple[str, ...]:
    """Names of the shapes that coefficients are given of: all that move skin and do not make the head another person.

    Raises
    ------
    EvalkitError
        If it has none.
    """
    skin = head.skin_vertices
    names = tuple(name for name in head.blendshapes if not name.startswith(IDENTITY) and _moves_skin(head, name, skin))
    if not names:
        raise EvalkitError(
            f"{head.name}: it has no shapes to give coefficients of; take a head with shapes, as makehuman"
        )
    return names


def bounded(gram: Array, right: Array) -> Array:
    """Minimum of ``x' G x / 2 - b' x``, ``0 <= x <= 1``, for each row b of (F, K), by accelerated projected gradients.

    Momentum starts anew in a frame where it points uphill.
    """
    # In units in which every shape has size one: those of a lid are small beside those of the jaw.
    size = np.sqrt(np.diag(gram))
    form, goal = gram / np.outer(size, size), right / size
    step = 1.0 / float(np.linalg.eigvalsh(form)[-1])
    values = ahead = np.zeros_like(goal)
    pace = np.ones((len(goal), 1))
    for _ in range(STEPS):
        new = np.clip(ahead - step * (ahead @ form - goal), 0.0, size)
        uphill = ((ahead - new) * (new - values)).sum(axis=1, keepdims=True) > 0.0
        pace = np.where(uphill, 1.0, pace)
        faster = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pace**2))
        ahead = new + np.where(uphill, 0.0, (pace - 1.0) / faster) * (new - values)
        change = float((np.abs(new - values) / size).max(initial=0.0))
        values, pace = new, faster
        if change < CLOSE:
            break
    return np.asarray(values / size)
