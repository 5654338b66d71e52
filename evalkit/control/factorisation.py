"""The paper's way to tell head pose from deformation: the matrix of all frames is factorised.

Every frame is a turned mixture of a few basis shapes, ``M_f = R_f sum_l c_fl B_l``. Stacked over the frames the
centred positions are ``M = Q B`` with ``Q_f = [c_f1 R_f, ..., c_fL R_f]``, of rank 3L, and a singular value
decomposition gives the factors up to an invertible matrix: ``Q = Q' G``.

That the blocks of Q are scaled rotations does not fix G. With H = G G', of which the constraints are linear, every
``H = A (x) I + blocks [w_kl]x`` (A symmetric, w_kl = -w_lk) meets them all: 2 L² - L dimensions. The basis constraints
do fix it: let the shapes of L chosen frames be the basis. In the blocks of ``Q'_f Q'_chosen^-1`` G has cancelled,

    Q'_f Q'_chosen^-1 = [d_f1 R_f R_1', ..., d_fL R_f R_L'],

and all that is left to do is rotation synchronisation. No semidefinite programme is needed, as it is for the
projections of a camera. What no factorisation of this kind can tell is ``D (x) T``: another basis of the same shapes,
and one constant turn of the head's axes.

All of this needs 3L dimensions of deformation. A face hardly has them: a jaw, a lid or a brow adds one or two each,
and what remains of the 3L are then directions of the noise. The condition number of the chosen frames tells.

References
----------
Chai, Xiao & Hodgins, "Vision-based control of 3D facial animation" (2003), doi:10.2312/SCA03/193-206;
Xiao, Chai & Kanade, "A closed-form solution to non-rigid shape and motion recovery", IJCV 67 (2006),
doi:10.1007/s11263-005-3962-9 (rotation and basis constraints);
Singer, "Angular synchronization by eigenvectors and semidefinite programming", Appl. Comput. Harmon. Anal. 30 (2011),
doi:10.1016/j.acha.2010.02.001.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, mean_rotation, nearest_rotation
from evalkit.pose.model import whole_markers

SAFETY = 3.0
"""How far above the noise the weakest direction of the chosen frames must be. Noise alone gives a random matrix at most
``sigma (sqrt(P) + sqrt(3 L))``; frames chosen among all of a take for their volume reach up to twice that."""

MAX_MISFIT = 0.1
"""Largest part of the blocks' square that may be no scaled rotation; blocks at random reach 0.5."""

CANDIDATES = 4000
"""Frames, spread over the take, among which the basis frames are chosen."""


@dataclass(frozen=True, eq=False)
class Factorisation:
    """A take as ``x = R_f (sum_l c_fl B_l) + t_f``.

    Attributes
    ----------
    rotations : ndarray, shape (F, 3, 3)
        Determinant +1; their mean rotation is the identity. NaN in frames that lack a marker.
    translations : ndarray, shape (F, 3), mm
        The centre that was taken off each frame.
    coefficients : ndarray, shape (F, L), mm
    bases : ndarray, shape (L, M, 3)
        Orthonormal, by the square that they have in the shapes.
    chosen : ndarray of int, shape (L,)
        Frames whose shapes were the basis.
    condition : float
        Of the chosen frames: largest over least singular value of their 3L rows.
    largest_condition : float
        The condition number from which on their weakest direction may be that of the noise.
    noise_mm : float
        What is left beyond 3L dimensions, rms per axis: the noise, if the model holds.
    misfit : float
        Part of the square of the blocks that is no scaled rotation: 0 where the model holds.
    """

    rotations: Array
    translations: Array
    coefficients: Array
    bases: Array
    chosen: NDArray[np.intp]
    condition: float
    largest_condition: float
    noise_mm: float
    misfit: float

    @property
    def shapes(self) -> Array:
        """Deformed shape of every frame in the head's axes, mm, shape (F, M, 3)."""
        return np.asarray(np.tensordot(self.coefficients, self.bases, axes=1))


def factorise(
    points: ArrayLike,
    count: int,
    centre: Sequence[int] | None = None,
    labels: Sequence[str] | None = None,
    refuse: bool = True,
) -> Factorisation:
    """Factorise a take into head rotations and a number of basis shapes, in closed form.

    Parameters
    ----------
    points : array_like, shape (F, M, 3), mm, NaN where missing
        Any axes. Frames that lack a marker cannot be rows of the matrix: they are left out and come back as NaN.
    count : int
        L, the number of basis shapes, the mean shape included.
    centre : sequence of int, optional
        Markers whose mean is taken off each frame: those over bone. By default all, which is the paper's way; their
        mean moves with the jaw.
    labels : sequence of str, optional
        Names used in messages.
    refuse : bool
        Raise where the answer would be that of the noise. Without it the answer is given as it comes out, with the
        figures that tell what it is worth.

    Returns
    -------
    Factorisation

    Raises
    ------
    EvalkitError
        If there are too few markers or complete frames for so many bases; if the chosen frames are nearly dependent
        (condition number) or their blocks are not rotations (misfit), unless ``refuse`` is off.
    """
    x = whole_markers(points)
    if x.ndim != 3 or x.shape[2] != 3:
        raise EvalkitError(f"points have shape {x.shape}; expected (frames, markers, 3)")
    frames, markers = x.shape[:2]
    if count < 1 or 3 * count > markers - 1:
        raise EvalkitError(
            f"{count} bases span {3 * count} dimensions, and {markers} centred markers have {markers - 1}: "
            f"ask for 1 to {(markers - 1) // 3}, or align on rigid markers instead"
        )
    known = np.isfinite(x[:, :, 0]).all(axis=1)
    if known.sum() <= count:
        seen = np.isfinite(x[:, :, 0]).mean(axis=0)
        worst = int(np.argmin(seen))
        name = labels[worst] if labels is not None else f"marker {worst}"
        raise EvalkitError(
            f"{known.sum()} of {frames} frames have every marker, {count} bases need {count + 1} or more; "
            f"leave out {name}, which is seen in {seen[worst]:.0%} of the frames"
        )
    at = x[known][:, slice(None) if centre is None else np.asarray(centre, dtype=int)].mean(axis=1)
    rows = (x[known] - at[:, None]).transpose(0, 2, 1)
    # The triangular factor has the singular values and right vectors of the whole matrix, to full precision.
    strength, right = np.linalg.svd(np.linalg.qr(rows.reshape(-1, markers), mode="r"), full_matrices=False)[1:]
    rank = 3 * count
    beyond = max((3 * len(rows) - rank) * (markers - 1 - rank), 1)
    # Rounding is the noise of a take without any.
    noise_mm = float(np.sqrt((strength[rank:] ** 2).sum() / beyond)) + np.finfo(float).eps * float(strength[0])
    factor = rows @ right[:rank].T
    chosen = independent_frames(factor, count)
    size = np.linalg.svd(factor[chosen].reshape(rank, rank), compute_uv=False)
    condition = float(size[0] / size[-1]) if size[-1] > 0 else np.inf
    limit = float(size[0] / (SAFETY * noise_mm * (np.sqrt(markers) + np.sqrt(rank)))) if size[0] > 0 else 0.0
    if condition > limit and refuse:
        raise EvalkitError(
            f"the {count} most independent frames are nearly dependent: condition number {condition:.3g}, where "
            f"{noise_mm:.2g} mm beyond {rank} dimensions allow {limit:.3g}: they do not all stand out of it; ask "
            "for fewer bases, or align on rigid markers instead"
        )
    turns, amounts, misfit = rotations_and_coefficients(factor, chosen)
    if misfit > MAX_MISFIT and refuse:
        raise EvalkitError(
            f"{misfit:.0%} of the factor are no rotations (condition number {condition:.3g}): the take is no mixture "
            f"of {count} shapes; align on rigid markers instead"
        )
    shapes = np.einsum("fji,fjm->fmi", turns, rows).reshape(len(rows), -1)
    left, amount, bases = _orthonormal(amounts, np.linalg.lstsq(amounts, shapes, rcond=None)[0])
    rotations, translations = np.full((frames, 3, 3), np.nan), np.full((frames, 3), np.nan)
    coefficients = np.full((frames, count), np.nan)
    rotations[known], translations[known], coefficients[known] = turns, at, left * amount
    return Factorisation(
        rotations, translations, coefficients, bases.reshape(count, markers, 3), np.flatnonzero(known)[chosen],
        condition, limit, noise_mm, misfit,
    )  # fmt: skip


def independent_frames(factor: Array, count: int) -> NDArray[np.intp]:
    """Frames whose rows of the factor (F, 3, 3L) are the most independent: greedily those of the largest volume.

    Each frame has three rows. The next one is that whose rows have the largest volume after what the frames before
    span is taken off, as in a QR decomposition with column pivoting, three columns at a time.
    """
    some = np.unique(np.linspace(0, len(factor) - 1, min(len(factor), CANDIDATES)).astype(int))
    rest = factor[some].copy()
    chosen: list[int] = []
    for _ in range(count):
        volume = np.linalg.det(rest @ rest.transpose(0, 2, 1))
        volume[chosen] = -np.inf
        best = int(np.argmax(volume))
        chosen.append(best)
        span = np.linalg.svd(rest[best], full_matrices=False)[2]
        rest -= (rest @ span.T) @ span
    return some[chosen]


def rotations_and_coefficients(factor: ArrayLike, chosen: ArrayLike) -> tuple[Array, Array, float]:
    """Rotations and mixing amounts out of a factor that is known up to an invertible matrix.

    Parameters
    ----------
    factor : array_like, shape (F, 3, 3L)
        Q', any basis of the columns of Q.
    chosen : array_like of int, shape (L,)
        Frames whose shapes are the basis.

    Returns
    -------
    rotations : ndarray, shape (F, 3, 3)
        R, their mean the identity.
    amounts : ndarray, shape (F, L)
        d: every shape as a mixture of those of the chosen frames.
    misfit : float
        ``sum |N - d R R_k'|² / sum |N|²`` over the blocks N of the frames that are not chosen.

    Raises
    ------
    EvalkitError
        If the chosen frames fall into groups that no other frame mixes, so that nothing ties their turns together.
    """
    q, which = np.asarray(factor, dtype=np.float64), np.asarray(chosen, dtype=int)
    count = len(which)
    # Pseudo-inverse: where frames are dependent and nobody refuses, the answer is wrong but finite.
    inverse = np.linalg.pinv(q[which].reshape(3 * count, 3 * count), rcond=1e-14)
    blocks = (q @ inverse).reshape(len(q), 3, count, 3).transpose(0, 2, 1, 3)
    # det(d R R_k') = d³ with its sign, which is what makes R proper.
    weighted = np.cbrt(np.linalg.det(blocks))[:, :, None, None] * blocks
    stacked = weighted.transpose(0, 2, 1, 3).reshape(-1, 3 * count)
    tied = stacked.T @ stacked  # blocks jk: sum_f d_fj² d_fk² R_j R_k'
    degree = np.sqrt(np.maximum(np.abs(np.einsum("jaka->jk", tied.reshape(count, 3, count, 3))).sum(axis=1), 1e-300))
    scale = np.repeat(1.0 / degree, 3)
    values, vectors = np.linalg.eigh(scale[:, None] * tied * scale)
    if count > 1 and values[-4] > (1.0 - 1e-9) * values[-3]:
        raise EvalkitError("the chosen frames fall into groups that no frame mixes; ask for fewer bases")
    turned = vectors[:, -3:].reshape(count, 3, 3)
    turned *= np.sign(np.linalg.det(turned).sum()) or 1.0
    own = nearest_rotation(turned)
    rotations = nearest_rotation(np.einsum("fkab,kbc->fac", weighted, own))
    amounts = np.einsum("fac,fkab,kbc->fk", rotations, blocks, own, optimize=True) / 3.0
    others = np.ones(len(q), dtype=bool)
    others[which] = False
    total = float((blocks[others] ** 2).sum())
    # |N - d R R_k'|² = |N|² - 3 d² at the best d.
    misfit = 1.0 - 3.0 * float((amounts[others] ** 2).sum()) / total if total > 0 else 0.0
    return rotations @ mean_rotation(rotations).T, amounts, max(misfit, 0.0)


def _orthonormal(amounts: Array, bases: Array) -> tuple[Array, Array, Array]:
    """Singular value decomposition of ``amounts @ bases``, (F, L) and (L, 3M), signs fixed by the largest element."""
    tall, small = np.linalg.qr(amounts)
    left, size, right = np.linalg.svd(small @ bases, full_matrices=False)
    sign = np.sign(right[np.arange(len(right)), np.argmax(np.abs(right), axis=1)])
    return tall @ left * sign, size, right * sign[:, None]
