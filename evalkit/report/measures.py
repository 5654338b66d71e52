"""What the report's pictures and tables are made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evalkit.capture import Capture
from evalkit.capture.origin import screen_axes
from evalkit.compensation import Compensation
from evalkit.errors import FrameStatus
from evalkit.geometry import Array, nearest_rotation, rotation_vector
from evalkit.pose import pose_estimators
from evalkit.render.markers import head_columns, position_columns

WALK_MM = 300.0
"""A head that travels further than this is walking; pictures of its motion let the picture travel along."""


@dataclass(frozen=True, eq=False)
class View:
    """A take and its result as the pictures show them.

    Attributes
    ----------
    take : Capture
    result : Compensation
    columns : ndarray of int
        Markers shown.
    rigid : ndarray of bool
        Which of them are rigid; of weighted markers, those that tell most.
    left, up, forward : ndarray, shape (3,)
        The performer's directions in world axes.
    centre : ndarray, shape (3,), mm
        Middle of the rigid markers in the reference pose.
    ok : ndarray of bool, shape (F,)
        Frames with a head pose.
    path : ndarray, shape (F, 3), mm
        Displacement of the rigid markers' middle from the reference pose.
    left_out : int
        Positions that are not shown because they are not on the head.
    walking : bool
        Whether pictures of the observed markers have this displacement taken out.
    """

    take: Capture
    result: Compensation
    columns: np.ndarray
    rigid: np.ndarray
    left: Array
    up: Array
    forward: Array
    centre: Array
    ok: np.ndarray
    path: Array
    left_out: int
    walking: bool

    @classmethod
    def of(cls, take: Capture, result: Compensation) -> View:
        """Choose what to show."""
        columns = head_columns(take, result)
        up, forward = screen_axes(take)
        centre = result.template.mean(axis=0)
        path = result.rotations @ centre + result.translations - centre
        ok = result.frame_status == FrameStatus.OK
        walking = bool(np.ptp(path[ok], axis=0).max(initial=0.0) > WALK_MM)
        rigid = np.isin(columns, np.array(result.chosen.columns)[result.chosen.leading])
        left_out = len(position_columns(take)) - len(columns)
        left = np.cross(up, forward)
        return cls(take, result, columns, rigid, left, up, forward, centre, ok, path, left_out, walking)

    @property
    def labels(self) -> list[str]:
        """Names of the markers shown."""
        return [self.take.labels[c] for c in self.columns]

    def before(self, frames: np.ndarray) -> Array:
        """Observed markers of some frames as the pictures show them, mm."""
        points = self.take.points[np.ix_(frames, self.columns)]
        return points - self.path[frames, None] if self.walking else points

    def after(self, frames: np.ndarray) -> Array:
        """Compensated markers of some frames, mm."""
        return self.result.capture.points[np.ix_(frames, self.columns)]

    def frames(self, most: int) -> np.ndarray:
        """At most so many frames, spread evenly over the take."""
        return np.unique(np.linspace(0, self.take.frames - 1, min(self.take.frames, most)).astype(int))

    def turns(self) -> tuple[Array, list[str]]:
        """Rotation vectors in the performer's axes, deg, shape (F, 3), and their names."""
        rotations = self.result.rotations
        method = pose_estimators.get(self.result.pose_method)
        if method is not None and not method.orthogonal:
            rotations = nearest_rotation(rotations)
        axes = np.stack([self.left, self.up, self.forward])
        names = [
            f"{word} (about {signed_axis(axis)})" for word, axis in zip(("nod", "turn", "tilt"), axes, strict=True)
        ]
        return np.degrees(rotation_vector(rotations)) @ axes.T, names


def signed_axis(axis: Array) -> str:
    """A world axis by name, such as +x or −y."""
    k = int(np.argmax(np.abs(axis)))
    return ("+" if axis[k] > 0 else "−") + "xyz"[k]


def movement_rms(points: Array) -> Array:
    """Distance of every marker from its own mean place, rms over the frames, mm; (F, M, 3) to (M,)."""
    seen = np.isfinite(points[:, :, 0])
    count = np.maximum(seen.sum(axis=0), 1)
    x = np.where(seen[:, :, None], points, 0.0)
    mean = x.sum(axis=0) / count[:, None]
    square = np.where(seen[:, :, None], x - mean, 0.0)
    out = np.sqrt(np.einsum("fmi,fmi->m", square, square) / count)
    return np.where(seen.any(axis=0), out, np.nan)


def envelope(times: Array, values: Array, bins: int) -> tuple[Array, Array]:
    """Smallest and largest value of every stretch of time, one after the other; (F,), (F, K) to (2B,), (2B, K).

    What a line through all the samples would look like on paper. Takes of up to twice as many frames as there
    are stretches come back as they are. A stretch without any value stays NaN.
    """
    if len(values) <= 2 * bins:
        return times, values
    size = -(-len(values) // bins)
    filled = np.full((-(-len(values) // size) * size, values.shape[1]), np.nan)
    filled[: len(values)] = values
    stretches = filled.reshape(-1, size, values.shape[1])
    out = np.stack([np.fmin.reduce(stretches, axis=1), np.fmax.reduce(stretches, axis=1)], axis=1)
    starts = times[::size]
    step = (times[1] - times[0]) * size
    return np.stack([starts, starts + 0.5 * step], axis=1).ravel(), out.reshape(-1, values.shape[1])


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of True as (first, one past the last)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
