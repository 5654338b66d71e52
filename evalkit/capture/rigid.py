"""Which markers move with the skull: given by name, or the set whose mutual distances vary least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from evalkit.capture.model import Capture
from evalkit.errors import EvalkitError

MAX_FRAMES = 5000
"""Frames that the distances are taken from, spread evenly over the take."""

MAX_CANDIDATES = 40
"""Markers among which every triple is tried; in larger takes those whose distances vary least."""

MIN_SEEN = 0.5
"""Part of the frames in which a marker must be seen to be chosen automatically."""


@dataclass(frozen=True, eq=False)
class RigidMarkers:
    """The rigid markers of a take and why they were chosen.

    Attributes
    ----------
    labels : list of str
    columns : list of int
        Their columns in the capture.
    automatic : bool
    reason : str
        The choice in words.
    pair_mean, pair_std : ndarray, shape (R, R), mm
        Mean and standard deviation over frames of the distance between each two of them: the evidence.
    weights : ndarray, shape (R,)
        Relative inverse variances, the largest 1; all 1 unless skin motion was estimated.
    skin_std : ndarray, shape (R,), mm
        Standard deviation per axis of each marker's motion over the skull, NaN where it was not estimated.
    share : ndarray, shape (R,)
        Part of the information about rotation that each marker has, NaN where it was not estimated.
    warnings : list of str
        What a user should know before trusting the choice, in words.
    """

    labels: list[str]
    columns: list[int]
    automatic: bool
    reason: str
    pair_mean: NDArray[np.float64]
    pair_std: NDArray[np.float64]
    weights: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    skin_std: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    share: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name, unknown in (("weights", 1.0), ("skin_std", np.nan), ("share", np.nan)):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.full(len(self.columns), unknown))

    @property
    def weighted(self) -> bool:
        """Whether the markers are weighted by how their skin moves."""
        return bool(np.isfinite(self.share).all())

    @property
    def leading(self) -> NDArray[np.intp]:
        """Positions in ``labels`` of the :data:`LEADING` weighted markers that tell most; of all if not weighted."""
        if not self.weighted:
            return np.arange(len(self.columns))
        return np.sort(np.argsort(-self.share, kind="stable")[:LEADING])


LEADING = 8
"""Markers, those that tell most of the rotation, that stand for all where all of a face is weighted."""


def choose_rigid(take: Capture, rigid: str | Sequence[str] = "auto", size: int | None = None) -> RigidMarkers:
    """Rigid markers by label, or automatically with ``"auto"``.

    Automatic: among markers seen in at least half of the frames, the set S with the smallest predicted squared
    rotation error ``v_S trace(J_S^-1)``, where v_S is half the mean variance of the distances within S (the
    variance per axis of a marker, if distances scatter for no other reason) and J_S the second moment of the
    mean shape. It balances "vary least" against "stand far apart": the best triple first, then one marker at
    a time while the error falls. Skin that slides as one piece changes no distance and is not noticed.

    Parameters
    ----------
    take : Capture
    rigid : "auto" or sequence of str
    size : int, optional
        Choose automatically exactly this many.

    Raises
    ------
    EvalkitError
        If a label is unknown, given twice or not a position, fewer than three are named, or no three markers
        can serve.
    """
    if isinstance(rigid, str) and rigid == "auto":
        return _automatic(take, size)
    labels = [rigid] if isinstance(rigid, str) else [str(label) for label in rigid]
    columns = take.indices(labels)
    for k, label in enumerate(labels):
        if label in labels[:k]:
            raise EvalkitError(f"rigid marker '{label}' is named twice; name each once")
        if take.quantities[columns[k]] != "position":
            raise EvalkitError(f"'{label}' is a {take.quantities[columns[k]]}, not a position; choose markers")
    if len(labels) < 3:
        raise EvalkitError(
            f"{len(labels)} rigid marker{'s' if len(labels) != 1 else ''} ({', '.join(labels)}); "
            "a rotation needs at least three that are not in one line"
        )
    points = take.points[:, columns]
    hidden = [labels[k] for k in np.flatnonzero(~np.isfinite(points[:, :, 0]).any(axis=0))]
    if len(hidden) == len(labels):
        raise EvalkitError(f"rigid markers {', '.join(labels)} are missing in every frame; choose others")
    if hidden:
        raise EvalkitError(f"rigid marker {', '.join(hidden)} is missing in every frame; choose others")
    mean, std = distance_variation(points)
    return RigidMarkers(labels, columns, False, "named by the user", mean, std)


def distance_variation(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation over frames of every mutual distance.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm, NaN where missing

    Returns
    -------
    mean, std : ndarray, shape (M, M), mm
        NaN where two markers are never seen together (std: in fewer than two frames).
    """
    some = np.linspace(0, max(len(points) - 1, 0), min(len(points), MAX_FRAMES)).astype(int)
    x = points[some]
    count_markers = x.shape[1]
    mean, std = np.full((2, count_markers, count_markers), np.nan)
    for j in range(count_markers):
        distance = np.linalg.norm(x - x[:, j : j + 1], axis=2)
        seen = np.isfinite(distance)
        count = seen.sum(axis=0)
        total = np.where(seen, distance, 0.0).sum(axis=0)
        average = np.divide(total, count, out=np.full(count_markers, np.nan), where=count > 0)
        square = np.where(seen, distance - average, 0.0) ** 2
        mean[j] = average
        std[j] = np.sqrt(np.divide(square.sum(axis=0), count - 1, out=np.full(count_markers, np.nan), where=count > 1))
    return mean, std


def _automatic(take: Capture, size: int | None) -> RigidMarkers:
    positions = np.array([kind == "position" for kind in take.quantities])
    seen = take.visible.mean(axis=0) if take.frames else np.zeros(len(take.labels))
    columns = np.flatnonzero(positions & (seen >= MIN_SEEN))
    if len(columns) < 3:
        raise EvalkitError(
            f"only {len(columns)} markers are seen in half of the frames or more; "
            "name at least three rigid markers yourself"
        )
    mean, std = distance_variation(take.points[:, columns])
    variance = std**2
    if len(columns) > MAX_CANDIDATES:
        # A marker of a rigid set has several partners at a steady distance.
        partners = np.sort(np.where(np.isfinite(variance), variance, np.inf), axis=1)[:, 1:6].mean(axis=1)
        kept = np.sort(np.argsort(partners, kind="stable")[:MAX_CANDIDATES])
        columns, mean, variance = columns[kept], mean[np.ix_(kept, kept)], variance[np.ix_(kept, kept)]
    shape = _shape_from_distances(mean)
    chosen = _best_triple(shape, variance)
    if chosen is None:
        names = ", ".join(take.labels[c] for c in columns[:12])
        raise EvalkitError(f"no three markers off one line are seen together ({names}); name the rigid markers")
    error = _predicted(shape, variance, np.array([chosen]))[0]
    while len(chosen) < min(len(columns), size or len(columns)):
        rest = [k for k in range(len(columns)) if k not in chosen]
        errors = _predicted(shape, variance, np.array([[*chosen, k] for k in rest]))
        best = int(np.argmin(errors))
        if size is None and not errors[best] < error:
            break
        chosen, error = [*chosen, rest[best]], errors[best]
    picked = sorted(int(columns[k]) for k in chosen)
    labels = [take.labels[c] for c in picked]
    mean, std = distance_variation(take.points[:, picked])
    off = std[np.triu_indices(len(picked), 1)]
    reason = (
        f"found automatically among {len(columns)} markers: their distances vary by {off.min():.2f} to "
        f"{off.max():.2f} mm (standard deviation), predicted rotation error {np.degrees(np.sqrt(error)):.2f} deg"
    )
    return RigidMarkers(labels, picked, True, reason, mean, std)


def _shape_from_distances(mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coordinates (M, 3) whose distances are nearest to the mean ones: classical scaling (Torgerson 1952)."""
    square = np.where(np.isfinite(mean), mean, np.nanmax(mean)) ** 2
    centring = np.eye(len(square)) - 1.0 / len(square)
    values, vectors = np.linalg.eigh(-0.5 * centring @ square @ centring)
    return vectors[:, -3:] * np.sqrt(np.maximum(values[-3:], 0.0))


def _best_triple(shape: NDArray[np.float64], variance: NDArray[np.float64]) -> list[int] | None:
    triples = np.array(list(combinations(range(len(shape)), 3)))
    errors = _predicted(shape, variance, triples)
    best = int(np.argmin(errors))
    return list(triples[best]) if np.isfinite(errors[best]) else None


def _predicted(
    shape: NDArray[np.float64], variance: NDArray[np.float64], sets: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Predicted squared rotation error, rad², of sets of markers (N, K); infinite where they cannot serve."""
    size = sets.shape[1]
    upper = np.triu_indices(size, 1)
    # A floor of a micrometre keeps noise-free takes comparable by their geometry.
    per_axis = np.maximum(variance[sets[:, upper[0]], sets[:, upper[1]]].mean(axis=1) / 2.0, 1e-6)
    centred = shape[sets] - shape[sets].mean(axis=1, keepdims=True)
    second = centred.transpose(0, 2, 1) @ centred
    inertia = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    moments = np.linalg.eigvalsh(inertia)
    line = np.linalg.eigvalsh(second)[:, 1] <= 1e-2 * moments[:, 2]
    error = per_axis * (1.0 / np.maximum(moments, 1e-12)).sum(axis=1)
    return np.where(line | ~np.isfinite(error), np.inf, error)
