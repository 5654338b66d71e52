"""The 19 points followed through the frontal view: an affine motion of a patch about each, by its grey levels.

Every patch is compared with its key references: pictures of the same patch in the first frame and in expressions met
since. A coarse search over all places within reach and all references, by correlation and by contrast, gives the
start; from there Gauss-Newton in its inverse compositional form (Baker & Matthews 2004,
doi:10.1023/B:VISI.0000011205.11775.fd) finds the affine motions. It
minimises, over the grey levels less their mean and over their standard deviation::

    sum_i t_i sum_g w_i(g) (I(p_i + A_i g) - T_i(g))^2 + r (p - m)' C^-1 (p - m) + r sum_i |A_i - 1|^2 / s_i^2

with the weights ``w`` of the pixels ``g`` of a patch, the trust ``t`` in what it shows, the places ``m`` of the
neutral face, and the covariance ``C`` and spreads ``s`` that anatomy gives to the ways (:mod:`evalkit.vision.anatomy`).
What the picture does not show, such as the way of a brow along itself, is left to these; what they rule out, such as a
lid that goes sideways, does not happen.

Comparing with references instead of the frame before, there is no drift in time. A patch that agrees with none of them
any more, but is still recognised, becomes a reference itself. Its own place is only as good as the reference it was
found by, hence it is of the next generation, which is used where the older ones agree markedly less.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.vision.anatomy import (
    COMMON_MM,
    CORNERS,
    LIDS,
    LIPS,
    MIRRORED,
    POINT_KINDS,
    SKULL,
    SPREAD_MM,
    ways_precision,
)
from evalkit.vision.camera import Camera
from evalkit.vision.depths import LearntDepths
from evalkit.vision.frontal import PIXEL_MM, FrontalView, Map
from evalkit.vision.patches import (
    COARSE,
    COARSE_WEIGHT,
    FLOOR,
    REFERENCES,
    WEIGHT,
    References,
    halved,
    normalised,
    read,
    relative_contrast,
)
from evalkit.vision.points import FACE_POINTS
from evalkit.vision.tracker import HeadPose, Picture, TrackStatus

REACH = (4, 5)
"""Half-resolution pixels over which a patch is searched to the sides and up and down: a lid closes by 10 mm in two
frames of 25 a second."""

ROUNDS = 4
"""Of Gauss-Newton, from a start that is at most a pixel off."""

RESIDUAL = 0.05
"""Variance of what a good match leaves over, in units of the patch's contrast, by the number of independent pixels:
what the spreads of anatomy are weighed against."""

CONTRAST = 0.4
"""Spread of the logarithm of a patch's contrast over its brightness about its reference's: folds and shadows change it
by a third. Correlation does not tell the inner edge of an open lip from the outer one, but against the dark of the
mouth it has three times the contrast."""

SPEED_MM = 5.0
"""Spread of a point's way from one frame to the next."""

RECOGNISED = 0.45
"""Correlation under which a patch is not the point that was searched for."""

SHUT_MM = 3.0
"""Gap under which the upper lid speaks for the lower one."""

INFERRED = 0.3
"""Confidence of a point that others speak for, as a share of theirs."""

AGREES = 0.92
"""Correlation from which a reference says all there is; under it the patch is worth a reference of its own."""

WORTH_KEEPING = 0.7
"""Correlation under which a patch may just as well be another place that looks like it, and becomes no reference."""

GENERATION_COST = 0.03
"""What a reference of the next generation must agree better by."""

GENERATIONS = 3
"""How long a chain of references may be: each link adds its own error of registration."""

PATIENCE = 5
"""Frames between new references of a point, which would be all alike in one quick movement, and for which it must have
been in sight without a gap."""

GRAZING = (0.1, 0.55)
"""Cosines between skin and view from which and to which a point counts."""


DEPTHS = ("learnt", "face", "cylinder")
"""What the depths of the points may be taken from."""

FURTHEST = 3.0
"""Spreads beyond which no point goes."""

_COUNT = len(FACE_POINTS)
_POINTS = np.arange(_COUNT)
_SPREAD = SPREAD_MM / PIXEL_MM
_STIFFNESS = RESIDUAL * PIXEL_MM**2 * ways_precision()
# A matrix that may not change is held by a spread of a thousandth.
_FORM = RESIDUAL / np.maximum([kind.spread_affine for kind in POINT_KINDS], 1e-3) ** 2
_REACH_PX = FURTHEST * np.hypot(SPREAD_MM, COMMON_MM) / PIXEL_MM
_OFFSETS = np.stack(
    np.meshgrid(np.arange(-REACH[0], REACH[0] + 1), np.arange(-REACH[1], REACH[1] + 1)), axis=-1
).reshape(-1, 2)  # fmt: skip


class FeatureTracker:
    """Follows the 19 points of one person, one frame at a time.

    Parameters
    ----------
    camera : Camera
    depth : {"learnt", "face", "cylinder"}
        Where the points' depths come from: the mean face, corrected by what the video shows
        (:mod:`evalkit.vision.depths`); the mean face alone; the cylinder, as published.
    references : bool
        Whether patches become references. Without, only the first frame's are compared with.
    origin_mm : float, optional
        See :meth:`evalkit.vision.frontal.FrontalView.of`.

    Attributes
    ----------
    view : FrontalView
        The frontal view, once started.
    points_px : ndarray, shape (19, 2)
        The points in the last frame itself; NaN where not known.
    slopes : ndarray, shape (19, 2)
        How far the line of sight to each point goes sideways and up for each mm forward, less the same in the first
        frame; of the last frame.
    offset_mm : ndarray, shape (19,)
        What the depths were corrected by in the last frame. A point found in a frame with another offset is brought to
        these depths by adding the difference times its slopes.
    """

    view: FrontalView
    points_px: Array
    slopes: Array
    offset_mm: Array

    def __init__(
        self, camera: Camera, depth: str = "learnt", references: bool = True, origin_mm: float | None = None
    ) -> None:
        self._camera = camera
        self._origin = origin_mm
        self._depth = depth
        self._grows = references
        self._started = False

    def start(self, frame: Picture, pose: HeadPose, points_px: ArrayLike) -> tuple[Array, Array]:
        """Begin with a frame in which the points are known and the face is at rest.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W) or (H, W, 3)
        pose : HeadPose
        points_px : array_like, shape (19, 2)

        Returns
        -------
        points, confidence : ndarray, shapes (19, 2) and (19,)
            As of :meth:`step`.

        Raises
        ------
        EvalkitError
            If the head is lost in that frame or the points fit no head in that pose.
        """
        if pose.status == TrackStatus.LOST:
            raise EvalkitError("features cannot start in a frame in which the head is lost")
        if self._depth not in DEPTHS:
            raise EvalkitError(f"depth '{self._depth}' is not one of {', '.join(DEPTHS)}")
        surface = "cylinder" if self._depth == "cylinder" else "face"
        self.view = FrontalView.of(pose, self._camera, points_px, surface, self._origin)
        self._neutral = self.view.from_picture(points_px, pose)
        self._face = self._neutral.copy()
        self._normals, self._height = self.view.normals(self._neutral), self.view.lifted(self._neutral)[:, 2]
        self._first = _slopes(self.view.lifted(self._neutral), pose)
        self._learnt = LearntDepths(SPREAD_MM, MIRRORED)
        self.offset_mm, self.slopes = np.zeros(_COUNT), np.zeros((_COUNT, 2))
        self._home = self._place = self.view.pixels(self._neutral)
        self.points_px = np.array(points_px, dtype=np.float64)
        self._matrix = np.repeat(np.eye(2)[None], _COUNT, axis=0)
        self._references = References(_FORM)
        self._chosen = np.zeros(_COUNT, dtype=int)
        self._clock = 0
        self._lost = False
        self._since = np.full(_COUNT, -PATIENCE)
        self._added = self._since.copy()
        seen = self.view.warp(frame, pose)
        self._references.add(seen, halved(seen), _POINTS, self._place, np.zeros(_COUNT, dtype=int), 0)
        self._started = True
        return self._neutral.copy(), np.ones(_COUNT)

    def step(self, frame: Picture, pose: HeadPose) -> tuple[Array, Array]:
        """Find the points in the next frame.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W) or (H, W, 3)
        pose : HeadPose

        Returns
        -------
        points : ndarray, shape (19, 2), mm
            In the frontal view: x to the person's left, y up, in the head's axes. NaN where the head is lost or the
            point is not recognised.
        confidence : ndarray, shape (19,)
            0 to 1.
        """
        if not self._started:
            raise EvalkitError("features: start before the first step")
        self._clock += 1
        if pose.status == TrackStatus.LOST:
            self._lost = True
            self.points_px = np.full((_COUNT, 2), np.nan)
            return np.full((_COUNT, 2), np.nan), np.zeros(_COUNT)
        seen = self.view.warp(frame, pose)
        half = halved(seen)
        if self._lost:
            # Who comes back may look like anything: all is searched from the neutral face.
            self._face = self._neutral.copy()
            self._lost = False
        self.slopes = _slopes(np.append(self._face, self._height[:, None], axis=1), pose) - self._first
        aside = self.offset_mm[:, None] * self.slopes
        self._home, self._place = self.view.pixels(self._neutral - aside), self.view.pixels(self._face - aside)
        start, chosen = self._search(half)
        self._matrix[chosen != self._chosen] = np.eye(2)
        self._chosen = chosen
        shown = self._shown(pose)
        place, agreement = self._register(seen, start, shown)
        return self._settled(seen, half, place, agreement, shown, pose)

    def _shown(self, pose: HeadPose) -> Array:
        """How squarely the skin at each point is seen, 0 to 1, shape (19,)."""
        sight = np.append(self._face, self._height[:, None], axis=1) @ pose.rotation.T + pose.translation
        facing = -np.einsum("pi,pi->p", self._normals @ pose.rotation.T, sight) / np.linalg.norm(sight, axis=1)
        return np.clip((facing - GRAZING[0]) / (GRAZING[1] - GRAZING[0]), 0.0, 1.0)

    def _search(self, half: Map) -> tuple[Array, NDArray[np.intp]]:
        """Best place within reach on the grid of every second pixel, and the reference that says so."""
        middle = np.rint(self._place / 2 - 0.25).astype(int)
        rows = middle[:, 1, None] + np.arange(-COARSE - REACH[1], COARSE + REACH[1] + 1)
        columns = middle[:, 0, None] + np.arange(-COARSE - REACH[0], COARSE + REACH[0] + 1)
        height, width = half.shape
        area = half[np.clip(rows, 0, height - 1)[:, :, None], np.clip(columns, 0, width - 1)[:, None, :]]
        side = 2 * COARSE + 1
        patches = sliding_window_view(area, (side, side), axis=(1, 2)).reshape(_COUNT, -1, side**2)
        generation = self._references.generation[:, None]
        # References are centred, so that the patch's mean drops out of the product.
        products = np.matmul(patches, self._coarse_products())
        power = np.matmul(patches * patches, COARSE_WEIGHT[:, :, None])[:, :, 0]
        contrast = np.sqrt(np.maximum(power - products[:, :, -1] ** 2, 0) + np.float32(FLOOR**2))
        relative = relative_contrast(products[:, :, -1], contrast)[:, :, None] - self._references.relative[:, None]
        score = products[:, :, :-1] / contrast[:, :, None] - GENERATION_COST * generation
        score -= 0.5 * RESIDUAL * (relative / CONTRAST) ** 2
        score = np.where(generation >= 0, score, -np.inf)
        place = 2 * (middle[:, None] + _OFFSETS) + 0.5
        home = self._home + self._common()
        way, step = (place - home[:, None]) / _SPREAD[:, None], (place - self._place[:, None]) * (PIXEL_MM / SPEED_MM)
        cost = 0.5 * RESIDUAL * ((way**2).sum(axis=2) + (step**2).sum(axis=2))
        total = (score - cost[:, :, None]).reshape(_COUNT, -1)
        best = total.argmax(axis=1)
        return place[_POINTS, best // REFERENCES], best % REFERENCES

    def _coarse_products(self) -> Map:
        """What patches are multiplied with: the weighted references and, last, the weights."""
        weighted = COARSE_WEIGHT[:, None] * self._references.coarse
        return np.concatenate([weighted, COARSE_WEIGHT[:, None]], axis=1).transpose(0, 2, 1)

    def _common(self) -> Array:
        """The shift of all points: where the corners of the eyes are, which do not move on the skull."""
        return np.median((self._place - self._home)[SKULL], axis=0)

    def _register(self, seen: Map, start: Array, shown: Array) -> tuple[Array, Array]:
        """Affine motion of every patch from a start; places (19, 2) and correlations (19,)."""
        place, matrix = start.copy(), self._matrix
        rows = (_POINTS, self._chosen)
        known = self._references
        texture, descent, moves, mixed, form, cross = (
            a[rows] for a in (known.texture, known.descent, known.moves, known.mixed, known.form, known.cross)
        )
        for remaining in range(ROUNDS, -1, -1):
            patch, _ = normalised(read(seen, place, matrix), WEIGHT)
            agreement = (WEIGHT * patch * texture).sum(axis=1)
            if not remaining:
                break
            trust = np.clip((agreement - 0.3) / 0.4, 0.02, 1.0) * np.maximum(shown, 0.02)
            pull = np.matmul(descent, (patch - texture)[:, :, None])[:, :, 0]
            skew = pull[:, 2:] + _FORM[:, None] * (matrix - np.eye(2)).reshape(-1, 4)
            # The affine part is eliminated, so that what ties the points together has two unknowns for each.
            force = trust[:, None] * (pull[:, :2] - np.matmul(mixed, skew[:, :, None])[:, :, 0])
            system = _STIFFNESS.copy()
            for i, j in np.ndindex(2, 2):
                system[2 * _POINTS + i, 2 * _POINTS + j] += trust * moves[:, i, j]
            wanted = force.ravel() + _STIFFNESS @ (place - self._home).ravel()
            # A step beyond the patch is no small motion: the linear model says nothing about it.
            change = np.clip(np.linalg.solve(system, wanted).reshape(-1, 2), -2.0, 2.0)
            turn = np.matmul(form, (skew - np.matmul(change[:, None], cross)[:, 0])[:, :, None])[:, :, 0]
            matrix = _without(matrix, np.clip(turn, -0.2, 0.2).reshape(-1, 2, 2))
            place = place - change
        self._matrix = matrix
        return place, agreement

    def _settled(
        self, seen: Map, half: Map, place: Array, agreement: Array, shown: Array, pose: HeadPose
    ) -> tuple[Array, Array]:
        """Take places over where the point was recognised, learn references, and answer."""
        inside = (np.abs(place - self._home) <= _REACH_PX).all(axis=1)
        recognised = (agreement > RECOGNISED) & inside & (shown > 0)
        known = recognised.copy()
        confidence = np.clip((agreement - RECOGNISED) / (1 - RECOGNISED), 0.0, 1.0)
        for upper, lower in LIDS:
            gap = place[lower, 1] - place[upper, 1]
            if gap < 0:
                # Closed lids meet; they do not pass each other.
                place[[upper, lower], 1] = place[[upper, lower], 1].mean()
            if known[upper] and inside[lower] and gap < SHUT_MM / PIXEL_MM:
                # The lashes of a closed lid cover the edge of the lower one, which then is where it usually is.
                known[lower] = True
                confidence[lower] = max(confidence[lower], INFERRED * confidence[upper])
        if recognised.mean() > 0.5:
            # Corners of the eyes do not move on the skull: most of the face says where they are.
            hidden = SKULL & inside & ~recognised
            known |= hidden
            confidence[hidden] = INFERRED * np.median(confidence[recognised])
        self._place = np.where(inside[:, None], place, self._home)
        self._matrix[~recognised] = np.eye(2)
        generation = self._references.generation[_POINTS, self._chosen]
        self._references.use(_POINTS[recognised], self._chosen[recognised], self._clock)
        if self._grows and pose.status == TrackStatus.TRACKED:
            self._learn(seen, half, recognised & (shown == 1), agreement, generation)
        self._read_off(agreement * recognised, known, pose)
        confidence *= 0.9**generation * shown * pose.confidence
        return np.where(known[:, None], self._face, np.nan), np.where(known, confidence, 0.0)

    def _read_off(self, weight: Array, known: NDArray[np.bool_], pose: HeadPose) -> None:
        """Where the points are in the head: on their lines of sight, at their own depths, not on the view's surface.

        A corner of the mouth far on the side that turns away would gain 3 mm of way from 1 mm of the surface.
        """
        surface = self.view.lifted(self.view.places(self._place))
        slopes = _slopes(surface, pose)
        assumed = surface[:, :2] + (self._height - surface[:, 2])[:, None] * slopes
        self.slopes = slopes - self._first
        pixels = self._camera.project(surface @ pose.rotation.T + pose.translation)
        self.points_px = np.where(known[:, None], pixels, np.nan)
        if self._depth == "learnt":
            self._learnt.learn(slopes, assumed, weight * (pose.status == TrackStatus.TRACKED))
            self.offset_mm = self._learnt.offset_mm
            # Lids move too much for a depth of their own; they lie between the corners of their eye.
            for lids, corners in zip(LIDS, CORNERS, strict=True):
                self.offset_mm[lids] = self.offset_mm[corners].mean()
            # So does the lower lip: one yawn in a turn would be taken for a chin 15 mm further back.
            upper, lower = LIPS
            self.offset_mm[lower] = self.offset_mm[upper]
        self._face = assumed + self.offset_mm[:, None] * self.slopes

    def _learn(
        self, seen: Map, half: Map, known: NDArray[np.bool_], agreement: Array, generation: NDArray[np.int_]
    ) -> None:
        self._since = np.where(known, self._since, self._clock)
        new = (agreement > WORTH_KEEPING) & (agreement < AGREES) & (generation < GENERATIONS)
        new &= (self._clock - self._added >= PATIENCE) & (self._clock - self._since >= PATIENCE)
        if not new.any():
            return
        points = _POINTS[new]
        self._references.add(seen, half, points, self._place[new], generation[new] + 1, self._clock)
        self._added[points] = self._clock


def _slopes(points_mm: Array, pose: HeadPose) -> Array:
    """Slopes (N, 2) of the lines of sight to points (N, 3) in the head's axes."""
    sight = points_mm + pose.translation @ pose.rotation
    return sight[:, :2] / sight[:, 2:]


def _without(matrix: Array, change: Array) -> Array:
    """``matrix (1 + change)^-1`` of 2 x 2 matrices."""
    a, b, c, d = 1 + change[:, 0, 0], change[:, 0, 1], change[:, 1, 0], 1 + change[:, 1, 1]
    inverse = np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2) / (a * d - b * c)[:, None, None]
    return np.matmul(matrix, inverse)
