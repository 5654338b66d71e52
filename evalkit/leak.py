"""How much of the estimated head motion is explained by the face's own motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from evalkit.capture import Capture
from evalkit.compensation import Compensation
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, rotation_vector, undo_motion
from evalkit.seeds import generator

HALF_S = 0.15
"""Increments are taken between the means of two stretches of this length next to each other, s: short against a brow
raise or a nod, long against the noise."""

STEP_S = 0.05
"""Time between increments, s."""

ANCHORS = 4
"""Markers to which the distances of all others are taken; from four that do not lie in a plane they fix the shape."""

SHARE = 0.95
"""Part of the variance of the distances that their principal components have to carry."""

COMPONENTS = 8
"""Most components; with more, chance alone explains the head motion of a short take."""

APART_S = 1.0
"""Smallest circular shift, s, longer than a syllable or a nod; takes whose motion is remembered longer get more."""

FORGOTTEN = 0.1
"""Correlation below which an increment is taken as forgotten."""

FEWEST_WINDOWS = 100
"""Increments below which chance explains too much to say anything."""

FEWEST_SHIFTS = 20
"""Shifts below which a probability of 5 % cannot be seen."""

RANK = 1e-6
"""Directions of head motion with less than this part of the largest variance are rounding."""

LEVEL = 0.05
"""Probability of chance below which a leak is said to be there."""

AXES = (
    "rotation about x", "rotation about y", "rotation about z",
    "slide along x", "slide along y", "slide along z",
)  # fmt: skip
"""Components of the head's increments, axes of the reference pose: rotation, deg, and slide, mm, the displacement of
the rigid markers' centroid less what in this take goes with the rotation: a false rotation that is not about the neck
is a slide, too, by its lever arm."""


@dataclass(frozen=True, eq=False)
class Leak:
    """What the face's motion says about the head's.

    Attributes
    ----------
    score : float
        Share of the head motion that the face's motion explains beyond chance, along the direction of pose space
        in which it explains most, 0 to 1: ``(r2 - baseline_mean) / (1 - baseline_mean)``. NaN unless status is ok.
    r2 : float
        Largest squared canonical correlation.
    baseline_mean, baseline_95 : float
        Mean and 95 % quantile of the same under circular shifts of time.
    p_value : float
        Share of shifts that explain as much.
    status : str
        ``ok``, ``too-short``, ``too-few-markers`` or ``no-motion``.
    message : str
        The verdict in words.
    axis_share : ndarray, shape (6,)
        The same score for each of :data:`AXES` by itself: share of its variance. 0 where nineteen of twenty shifts
        do not explain less.
    axis_size : ndarray, shape (6,)
        Root mean square of the explained part beyond chance, deg and mm per increment (a change within about
        :data:`HALF_S`).
    markers : dict of str to float
        Label -> median over its distances to all other markers of their squared correlation with that direction,
        largest first: which parts of the face move when the head is said to.
    components : int
        Principal components of the distances used.
    increments : int
        Increments of the pose that are known.
    """

    score: float
    r2: float
    baseline_mean: float
    baseline_95: float
    p_value: float
    status: str
    message: str
    axis_share: Array = field(default_factory=lambda: np.full(6, np.nan))
    axis_size: Array = field(default_factory=lambda: np.full(6, np.nan))
    markers: dict[str, float] = field(default_factory=dict)
    components: int = 0
    increments: int = 0

    @property
    def present(self) -> bool:
        """Whether the face explains more of the head motion than chance does, at the level :data:`LEVEL`."""
        return self.status == "ok" and self.p_value <= LEVEL


def expression_leak(take: Capture, result: Compensation, *, permutations: int = 200, seed: int = 0) -> Leak:
    """How much of the estimated head motion the face's own motion explains, beyond chance.

    "Rigid" markers that ride on skin slide when the brows work; the slide enters the pose as head motion and comes
    back, with the opposite sign, in every compensated marker. So the pose follows the expression, which this score
    measures by canonical correlation between

    - increments of the head pose: rotation vector and displacement of the rigid markers' centroid, both in the
      head's axes, in which sliding skin always moves the same way; and
    - increments of the distances between the other markers, by their principal components.

    Errors of the pose move all compensated markers together, and would be found by regressing on these; distances do
    not change with the pose, so that noise of the rigid markers cannot pass as leak. Chance is what remains when
    the face is shifted in time against the head, circularly and by more than either remembers, which keeps the
    spectrum of both. The statistic is the largest squared canonical correlation; all directions of the pose count
    alike, also those in which a head hardly moves, such as a displacement that does not go with a turn about the
    neck. It is there that a small leak shows; the score says how clearly the markers slide, ``axis_share`` and
    ``axis_size`` how much of which motion it is.

    What it cannot tell: people do nod, tilt and lean with what they say. Head motion that truly goes with speech or
    brows counts as leak. On the other hand skin that slides without a change of distance among the other markers,
    and slides spread over a minute, go unseen.

    Parameters
    ----------
    take : Capture
        What was observed.
    result : Compensation
        Its head motion. Markers that are not in ``result.rigid`` are the face; where all markers were weighted by
        how their skin moves, those in the lighter half as well, whose own noise has next to no part in the pose.
    permutations : int
        Circular shifts; all that there are in takes too short for so many.
    seed : int
        Seed of the choice of shifts; the same arguments give the same bits.

    Returns
    -------
    Leak

    Raises
    ------
    EvalkitError
        If the result is of another take, or there are fewer than :data:`FEWEST_SHIFTS` permutations.

    References
    ----------
    Hotelling, "Relations between two sets of variates", Biometrika 28 (1936), doi:10.1093/biomet/28.3-4.321, on
    principal components of one set; circular shifts: Theiler et al., "Testing for nonlinearity in time series: the
    method of surrogate data", Physica D 58 (1992), doi:10.1016/0167-2789(92)90102-S, and Winkler et al.,
    "Permutation inference for canonical correlation analysis", NeuroImage 220 (2020),
    doi:10.1016/j.neuroimage.2020.117065.
    """
    if len(result.rotations) != take.frames:
        raise EvalkitError(
            f"the head motion has {len(result.rotations)} frames and the take {take.frames}: another take"
        )
    if permutations < FEWEST_SHIFTS:
        raise EvalkitError(f"{permutations} permutations cannot tell 5 % from chance; use {FEWEST_SHIFTS} or more")
    rigid = _rigid(result)
    faces = [
        k
        for k, (label, kind) in enumerate(zip(take.labels, take.quantities, strict=True))
        if kind == "position" and label not in rigid
    ]
    face = take.points[:, faces]
    often = np.isfinite(face[:, :, 0]).mean(axis=0) > 0.5
    face, labels = face[:, often], [take.labels[k] for k, keep in zip(faces, often, strict=True) if keep]
    if len(labels) < 3:
        return _silent("too-few-markers", f"{len(labels)} markers beside the rigid ones; an expression needs three")
    half, step = max(round(HALF_S * take.rate), 1), max(round(STEP_S * take.rate), 1)
    pose = _increments(_pose_path(take, result), half, step)
    known = np.asarray(np.isfinite(pose).all(axis=1))
    if known.sum() < FEWEST_WINDOWS:
        seconds = 1.5 * FEWEST_WINDOWS * step / take.rate
        return _silent("too-short", f"{known.sum()} increments of the head pose; take at least {seconds:.0f} s")
    # What the turns carry along would drown the slide of every axis in honest motion.
    pose[:, 3:] -= pose[:, :3] @ np.linalg.lstsq(pose[known, :3], pose[known, 3:], rcond=None)[0]
    head = _whitened(pose, known)
    distances = _increments(_distances(face, _anchors(face)), half, step)
    parts = _components(distances, int(known.sum()))
    if head is None or parts is None:
        still = "head" if head is None else "face"
        return _silent("no-motion", f"the {still} does not move in this take")
    shifts = _shifts(head, parts, max(round(APART_S / STEP_S), 1), permutations, seed)
    if len(shifts) < FEWEST_SHIFTS:
        return _silent("too-short", "the motion repeats itself too slowly for a take of this length")
    moved = _shifted_products(head, parts, np.concatenate([[0], shifts]))
    correlation = np.linalg.svd(moved, compute_uv=False)[:, 0].clip(max=1.0) ** 2
    r2, chance = float(correlation[0]), correlation[1:]
    # The axes by themselves: their variance explained is the length of their projection on the components.
    scaled = _scaled(pose, known)
    axes = (_shifted_products(scaled, parts, np.concatenate([[0], shifts])) ** 2).sum(axis=2).clip(max=1.0)
    clear = axes[0] > np.quantile(axes[1:], 0.95, axis=0)
    axis_share = np.where(clear, _beyond(axes[0], axes[1:].mean(axis=0)), 0.0)
    spread = np.sqrt(np.where(known[:, None], (pose - pose[known].mean(axis=0)) ** 2, 0.0).sum(axis=0) / known.sum())
    variate = head @ np.linalg.svd(moved[0])[0][:, 0]
    leak = Leak(
        score=float(_beyond(np.array(r2), np.array(chance.mean()))),
        r2=r2,
        baseline_mean=float(chance.mean()),
        baseline_95=float(np.quantile(chance, 0.95)),
        p_value=float((1 + (chance >= r2).sum()) / (1 + len(chance))),
        status="ok",
        message="",
        axis_share=axis_share,
        axis_size=np.sqrt(axis_share) * spread,
        markers=_by_marker(face, labels, variate, half, step),
        components=parts.shape[1],
        increments=int(known.sum()),
    )
    return _worded(leak)


def _silent(status: str, message: str) -> Leak:
    return Leak(np.nan, np.nan, np.nan, np.nan, np.nan, status, message)


def _worded(leak: Leak) -> Leak:
    """The leak with its verdict in words."""
    explained = f"the face's motion explains {leak.r2:.0%} of the head motion that goes with it most"
    chance = f"chance {leak.baseline_mean:.0%} (p = {leak.p_value:.2g})"
    if not leak.present:
        text = f"no expression leak to be seen: {explained}, {chance}"
    else:
        axes = [k for k in np.argsort(-leak.axis_share)[:2] if leak.axis_share[k] > 0]
        where = " and ".join(f"{AXES[k]} ({leak.axis_size[k]:.2g} {'deg' if k < 3 else 'mm'} rms)" for k in axes)
        text = (
            f"{explained}, {chance}: {where or 'no axis by itself'}, with {', '.join(list(leak.markers)[:3])}; "
            "the rigid markers slide with the skin, or the head moves with the face"
        )
    return replace(leak, message=text)


def _rigid(result: Compensation) -> set[str]:
    """Labels of the markers taken as rigid: where all were weighted by how their skin moves, the heavier half."""
    weights = result.chosen.weights
    return {label for label, heavy in zip(result.rigid, weights >= np.median(weights), strict=True) if heavy}


def _pose_path(take: Capture, result: Compensation) -> Array:
    """Rotation vector, deg, and displacement, mm, summed up in head axes; shape (F, 6), NaN without a pose.

    The displacement is that of the rigid markers' centroid: as observed where the head was turned about a pivot,
    since that pose need not follow it; as in the pose where that was free.
    """
    weights = result.chosen.weights / result.chosen.weights.sum()
    known = np.flatnonzero(np.isfinite(result.rotations[:, 0, 0]))
    r = result.rotations[known]
    middle = np.broadcast_to(weights @ result.template, (len(known), 3))
    if result.sway_used != "per-frame":
        columns = [take.labels.index(label) for label in result.rigid]
        off = undo_motion(r, result.translations[known], take.points[known][:, columns]) - result.template
        seen = np.where(np.isfinite(off[:, :, 0]), weights, 0.0)
        middle = middle + np.einsum("fm,fmi->fi", seen, np.nan_to_num(off)) / seen.sum(axis=1)[:, None]
    centre = np.einsum("fij,fj->fi", r, middle) + result.translations[known]
    turn = np.degrees(rotation_vector(r[:-1].transpose(0, 2, 1) @ r[1:]))
    # Half way between both frames, so that time reversed is motion reversed.
    move = 0.5 * np.einsum("fji,fj->fi", r[:-1] + r[1:], np.diff(centre, axis=0))
    path = np.full((take.frames, 6), np.nan)
    path[known[:1]] = 0.0
    path[known[1:]] = np.cumsum(np.hstack([turn, move]), axis=0)
    return path


def _anchors(face: Array) -> np.ndarray:
    """Markers far from each other, (up to) four of those that are seen most."""
    seen = np.isfinite(face[:, :, 0]).mean(axis=0)
    good = np.flatnonzero(seen >= min(0.9, float(np.median(seen))))
    some = face[:: max(len(face) // 1000, 1), good]
    # Distances, not places: heads move. Each is a mean over the frames that show both.
    apart = np.linalg.norm(some[:, :, None] - some[:, None], axis=3)
    both = np.isfinite(apart)
    far = np.where(both, apart, 0.0).sum(axis=0) / np.maximum(both.sum(axis=0), 1)
    chosen = [int(far.sum(axis=1).argmax())]
    while len(chosen) < min(ANCHORS, len(good)):
        chosen.append(int(far[chosen].min(axis=0).argmax()))
    return good[chosen]


def _distances(face: Array, anchors: np.ndarray) -> Array:
    """Distances of every marker from the anchors, each pair once, mm, shape (F, D)."""
    columns = []
    for k, anchor in enumerate(anchors):
        others = np.setdiff1d(np.arange(face.shape[1]), anchors[: k + 1])
        columns.append(np.linalg.norm(face[:, others] - face[:, [anchor]], axis=2))
    return np.hstack(columns)


def _increments(signal: Array, half: int, step: int) -> Array:
    """Mean of the next ``half`` frames less that of the last, every ``step`` frames; NaN where one has no frame."""
    seen = np.isfinite(signal)
    total = np.cumsum(np.pad(np.where(seen, signal, 0.0), ((1, 0), (0, 0))), axis=0)
    count = np.cumsum(np.pad(seen, ((1, 0), (0, 0))), axis=0)
    at = np.arange(half, len(signal) - half + 1, step)
    with np.errstate(invalid="ignore"):
        after = (total[at + half] - total[at]) / (count[at + half] - count[at])
        before = (total[at] - total[at - half]) / (count[at] - count[at - half])
    return np.asarray(after - before)


def _scaled(pose: Array, known: np.ndarray) -> Array:
    """Columns of mean 0 and length 1, zero where not known or without motion."""
    centred = np.where(known[:, None], pose - pose[known].mean(axis=0), 0.0)
    length = np.linalg.norm(centred, axis=0)
    return centred / np.where(length > 0, length, 1.0)


def _whitened(pose: Array, known: np.ndarray) -> Array | None:
    """Orthonormal columns that span the motion of the pose; None if there is none.

    A centroid that only goes where the rotation takes it adds no direction of its own.
    """
    scaled = _scaled(pose, known)
    values, axes = np.linalg.eigh(scaled.T @ scaled)
    if pose[known].std(axis=0).max() < 1e-9:
        return None
    keep = values > RANK * values[-1]
    return np.asarray(scaled @ axes[:, keep] / np.sqrt(values[keep]))


def _components(distances: Array, known: int) -> Array | None:
    """Orthonormal principal components (N, K) of the increments of the distances; None if the face is still."""
    seen = np.isfinite(distances)
    mean = np.where(seen, distances, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    # A distance that is not seen is taken to change as it does on average.
    centred = np.where(seen, distances - mean, 0.0)
    values, axes = np.linalg.eigh(centred.T @ centred)
    values, axes = values[::-1], axes[:, ::-1]
    if values[0] < 1e-18 * centred.size:
        return None
    enough = 1 + int(np.searchsorted(np.cumsum(values), SHARE * values.sum()))
    count = min(enough, COMPONENTS, max(known // 40, 1))
    return np.asarray(centred @ axes[:, :count] / np.sqrt(values[:count]))


def _shifted_products(a: Array, b: Array, shifts: np.ndarray) -> Array:
    """``sum_i a[i + s] b[i]`` with i + s modulo N, for every shift: (N, A), (N, B), (S,) to (S, A, B)."""
    over = np.fft.rfft(a, axis=0)[:, :, None] * np.fft.rfft(b, axis=0).conj()[:, None, :]
    return np.asarray(np.fft.irfft(over, n=len(a), axis=0)[shifts])


def _shifts(head: Array, parts: Array, apart: int, count: int, seed: int) -> np.ndarray:
    """Random circular shifts, larger than what either side remembers of itself."""
    for side in (head, parts):
        memory = np.fft.irfft((np.abs(np.fft.rfft(side, axis=0)) ** 2).sum(axis=1), n=len(side))
        lags = np.flatnonzero(memory[: len(side) // 2] < FORGOTTEN * memory[0])
        apart = max(apart, int(lags[0]) if len(lags) else len(side))
    allowed = np.arange(apart, len(head) - apart + 1)
    random = generator("expression leak", seed=seed)
    return np.sort(random.choice(allowed, size=min(count, len(allowed)), replace=False))


def _beyond(explained: Array, chance: Array) -> Array:
    """Share explained beyond chance, 0 to 1."""
    return ((explained - chance) / np.maximum(1.0 - chance, 1e-12)).clip(0.0, 1.0)


def _by_marker(face: Array, labels: list[str], variate: Array, half: int, step: int) -> dict[str, float]:
    """Label -> median squared correlation of a marker's distances from the others with a variate, largest first."""
    found = {}
    for k, label in enumerate(labels):
        apart = np.linalg.norm(np.delete(face, k, axis=1) - face[:, [k]], axis=2)
        moved = _increments(apart, half, step)
        seen = np.isfinite(moved)
        centred = np.where(seen, moved - np.where(seen, moved, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1), 0.0)
        length = np.maximum(np.linalg.norm(centred, axis=0), 1e-12)
        found[label] = float(np.median((variate @ centred / length) ** 2))
    return dict(sorted(found.items(), key=lambda item: -item[1]))
