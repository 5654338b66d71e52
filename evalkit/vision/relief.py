"""The depths of one person's face, learnt from the frames of a video in which the head has turned.

A surface made from 19 points of one picture has the depths of a mean face, tilted by what the first pose is wrong. Each
depth error moves a place of the skin sideways as soon as the head turns, which rigid motion can imitate only in part:
the poses come out wrong by a share of the turn. What is left over tells the two apart. A small bundle adjustment
(Triggs et al. 2000, doi:10.1007/3-540-44480-7_21) over some key frames minimises::

    sum_jk rho(|W_jk (project(R_k (c + s_j d_j) + T_k) - u_jk)|) + (s - s_0)' K^-1 (s - s_0)

over the distances ``s_j`` of places along their lines of sight ``d_j`` in the first frame, whose camera is at ``c`` in
the head's axes, and the poses of all key frames but the first. The places ``u_jk`` come from optical flow (Lucas &
Kanade 1981) between the unwrapped first frame and the unwrapped key frame, with its covariance. ``K`` says how faces
differ from the mean face: by a tilt, in depth as a whole, and smoothly from place to place.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from evalkit.geometry import Array, cross_matrix, nearest_rotation, rotation_from_vector
from evalkit.vision.camera import Camera
from evalkit.vision.registration import (
    LocalContrast,
    Template,
    View,
    agreement_of,
    box_mean,
    facing,
    gradients,
    sight_of,
)
from evalkit.vision.surface import FINEST, HALF_ANGLE_DEG, Map, Surface

EVERY = 3
"""Rows and columns of the finest grid from one place to the next."""

RIGID = 0.5
"""Weight of rigidity from which a place is used: no mouth, no lids, no hair."""

FLOW_WINDOW = 9
"""Rows and columns of the window of optical flow."""

FLOW_ROUNDS = 4
FIRMNESS = 0.003
"""Squared gradient added to a window's, contrast per cell: where nothing is to be seen nothing is taken to move."""

LONGEST_FLOW = 3.0
"""Cells. What would be further away is something else."""

LEAST_NOISE = 0.02
"""Variance of the difference of two normalised textures that match."""

SEEN = 0.3
"""Weight of visibility from which a place counts."""

AGREES = 0.5
"""Correlation after optical flow from which a place was found again."""

FLOW_SD = 2.5
"""Cells of the grid, some 4 mm each. Expression and shading move many places together and by less than this; that all
count as independent is paid for here. With 1, what they do passed for a flatter or a deeper face, and turns came out
too large or too small by up to 18 %."""

OVERLAP = 4.0
"""How often windows of neighbouring places count the same pixels, about."""

TILT_DEG = (8.0, 1.5)
"""Standard deviation of the first pose's nod and turn, which tilt the depths. A face has two sides that say how far it
is turned, and a height that may be anything."""

DEEPER = 0.06
"""Standard deviation of a face's depth relative to its width, as a fraction."""

BUMP_MM, BUMP_WIDTH_MM = 1.5, 22.0
"""Standard deviation of other differences, and how far apart places differ together."""

NUGGET_MM = 0.5

KEY_DEG = 4.0
"""Key frames are so far from each other."""

WIDEST_DEG = 40.0
"""Frames turned further from the first one show too little of what it showed."""

MOST_KEYS = 16

LEAST_LIFT = 0.3
"""Share of a move away from the axis along the normal below which the surface is too steep to be moved by it."""

BOUNDS = (0.4, 1.8)
"""Radii are kept within these factors of their mean."""

DISAGREEING = 3.0
"""Standard deviations at which a miss has a quarter of its weight."""

DEEP_FROM_MM = 60.0
"""Depth that does not change when a face is deeper: about that of the eye's centre of rotation."""

ROUNDS = 3
"""Of Gauss-Newton with reweighting."""


@dataclass(eq=False)
class Key:
    """A frame whose pose is adjusted.

    Attributes
    ----------
    number : int
        Of the frame.
    rotation, translation : ndarray
    places_px : ndarray, shape (J, 2)
    whiten : ndarray, shape (J, 2, 2)
        Takes pixels to standard deviations; 0 where a place was not found.
    """

    number: int
    rotation: Array
    translation: Array
    places_px: Array
    whiten: Array


class Relief:
    """Depths of a face, begun with a surface at the pose of the first frame.

    Parameters
    ----------
    surface : Surface
    camera : Camera
    rotation, translation : ndarray
        Of the first frame.
    usable : ndarray, shape (H, W)
        Weight of each place of the finest grid: how rigid, and how well seen in the first frame.
    """

    def __init__(self, surface: Surface, camera: Camera, rotation: Array, translation: Array, usable: Map) -> None:
        self._camera, self._begun = camera, surface
        inner = np.zeros(usable.shape, dtype=bool)
        inner[2:-2:EVERY, 2:-2:EVERY] = True
        points = surface.grids[0].points[(inner & (usable > RIGID)).ravel()].astype(np.float64)
        # The camera in the head's axes, and the lines of sight.
        self._eye = -rotation.T @ translation
        rays = points - self._eye
        self._first = np.linalg.norm(rays, axis=1)
        self._rays = rays / self._first[:, None]
        self._prior = np.linalg.inv(_covariance(points, points) + NUGGET_MM**2 * np.eye(len(points)))
        self._distance = self._first.copy()
        self._spread = _spread(surface, points, self._eye) @ self._prior
        self.keys: list[Key] = []

    @property
    def points(self) -> Array:
        """The places in the head's axes, (J, 3), mm."""
        return np.asarray(self._eye + self._distance[:, None] * self._rays)

    def add(
        self, number: int, view: View, surface: Surface, first: Template, rotation: Array, translation: Array
    ) -> Key:
        """Measure where the places are in a frame at about a pose, and take it for a key frame."""
        key = Key(number, rotation, translation, *_found(view, surface, first, rotation, translation, self.points))
        self.keys.append(key)
        return key

    def adjust(self) -> None:
        """Fit the places and the poses of the key frames to each other."""
        keys, count = len(self.keys), len(self._rays)
        size = 6 * keys
        matrix, right = np.zeros((size + count, size + count)), np.zeros(size + count)
        number, place = np.arange(keys), np.arange(size, size + count)
        for _ in range(ROUNDS):
            # Poses first, places last; the places' block is dense because of the prior.
            matrix[:] = 0.0
            miss, by_pose, by_distance = self._misses()
            flat, each = by_pose.reshape(keys, -1, 6), miss.reshape(keys, -1, 1)
            blocks = flat.transpose(0, 2, 1) @ flat + 1e-6 * np.eye(6)
            for k in number:
                matrix[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = blocks[k]
            across = (by_distance[..., None, :] @ by_pose)[:, :, 0].transpose(0, 2, 1).reshape(size, count)
            matrix[:size, size:], matrix[size:, :size] = across, across.T
            matrix[size:, size:] = self._prior
            matrix[place, place] += (by_distance**2).sum(axis=(0, 2))
            right[:size] = -(flat.transpose(0, 2, 1) @ each).ravel()
            right[size:] = -(by_distance * miss).sum(axis=(0, 2)) - self._prior @ (self._distance - self._first)
            step = np.linalg.solve(matrix, right)
            for key, (*turn, x, y, z) in zip(self.keys, step[:size].reshape(keys, 6), strict=True):
                key.rotation = nearest_rotation(key.rotation @ rotation_from_vector(np.array(turn)))
                key.translation = key.translation + np.array([x, y, z])
            self._distance = self._distance + step[size:]

    def _misses(self) -> tuple[Array, Array, Array]:
        """Whitened misses (K, J, 2), and their derivatives by pose (K, J, 2, 6) and by distance (K, J, 2)."""
        points = self.points
        rotations, translations, seen, whiten = (
            np.stack([getattr(key, name) for key in self.keys])
            for name in ("rotation", "translation", "places_px", "whiten")
        )
        placed = points @ rotations.transpose(0, 2, 1) + translations[:, None]
        depth, focal = -placed[..., 2], self._camera.focal_px
        miss = (whiten @ (self._camera.project(placed) - seen)[..., None])[..., 0]
        # Geman & McClure's weight: what moves by itself does not count.
        weight = 1.0 / (1.0 + (miss**2).sum(axis=-1) / DISAGREEING**2)
        by_place = np.zeros((*depth.shape, 2, 3))
        by_place[..., 0, 0], by_place[..., 1, 1] = focal / depth, -focal / depth
        by_place[..., 0, 2], by_place[..., 1, 2] = focal * placed[..., 0] / depth**2, -focal * placed[..., 1] / depth**2
        by_place = weight[..., None, None] * (whiten @ by_place)
        turned = by_place @ rotations[:, None]
        by_turn = -turned @ cross_matrix(points)
        return (
            weight[..., None] * miss,
            np.concatenate([by_turn, by_place], axis=-1),
            (turned @ self._rays[..., None])[..., 0],
        )

    def surface(self) -> Surface:
        """The surface with what was learnt, smooth between the places."""
        begun = self._begun
        grown = self._spread @ (self._distance - self._first)
        middle = float(begun.radii_mm.mean())
        radii = np.clip(begun.radii_mm + grown.reshape(begun.radii_mm.shape), BOUNDS[0] * middle, BOUNDS[1] * middle)
        return Surface(radii, begun.top_mm, begun.bottom_mm)


def _spread(begun: Surface, points: Array, eye: Array) -> Array:
    """How far the radii of a surface (N,) go with the distances of places (J,), by their covariance; (N, J)."""
    part = np.linspace(0.0, 1.0, FINEST + 1)
    angle = np.radians(HALF_ANGLE_DEG) * (2 * part - 1)[None, :]
    height = (begun.top_mm + (begun.bottom_mm - begun.top_mm) * part)[:, None]
    grid = np.stack([begun.radii_mm * np.sin(angle), height + 0 * angle, begun.radii_mm * np.cos(angle)], axis=-1)
    normals, flat = _normals(grid).reshape(-1, 3), grid.reshape(-1, 3)
    sight, outward = flat - eye, flat * [1.0, 0.0, 1.0]
    # A move along the line of sight and one away from the axis lift the surface by their shares along the normal.
    lift = (normals * sight).sum(axis=1) / np.linalg.norm(sight, axis=1)
    lift /= np.maximum((normals * outward).sum(axis=1) / np.linalg.norm(outward, axis=1), LEAST_LIFT)
    return lift[:, None] * _covariance(flat, points)


def _normals(points: Array) -> Array:
    across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normals = np.cross(down, across)
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def _covariance(one: Array, other: Array) -> Array:
    """Prior covariance (N, M) of the distances of places, mm^2."""
    apart = ((one[:, None, :2] - other[None, :, :2]) ** 2).sum(axis=2)
    smooth = BUMP_MM**2 * np.exp(-0.5 * apart / BUMP_WIDTH_MM**2)
    deep = DEEPER**2 * np.outer(one[:, 2] - DEEP_FROM_MM, other[:, 2] - DEEP_FROM_MM)
    nod, yaw = np.tan(np.radians(TILT_DEG))
    return np.asarray(
        smooth + deep + nod**2 * np.outer(one[:, 1], other[:, 1]) + yaw**2 * np.outer(one[:, 0], other[:, 0])
    )


def _found(
    view: View, surface: Surface, first: Template, rotation: Array, translation: Array, points: Array
) -> tuple[Array, Array]:
    """Pixels of places in a frame (J, 2), and what whitens them (J, 2, 2)."""
    grid = surface.grids[0]
    size = grid.shape[0]
    grey, inside = view.unwrap(grid, rotation, translation)
    common = first[0].weight * inside * facing(grid, sight_of(grid, rotation, translation))
    normalise = LocalContrast(common)
    texture = normalise(first[0].grey)
    column, row = (np.ascontiguousarray(x, dtype=np.float32) for x in np.meshgrid(np.arange(size), np.arange(size)))
    flow = np.zeros((2, size, size), np.float32)
    for _ in range(FLOW_ROUNDS):
        moved = cv2.remap(grey, column + flow[0], row + flow[1], cv2.INTER_LINEAR)
        seen = normalise(moved.astype(np.float32, copy=False))
        x, y = gradients(np.float32(0.5) * (seen + texture))
        rest = seen - texture
        xx, xy, yy, xr, yr, rr, mass = (
            box_mean(common * v, FLOW_WINDOW) for v in (x * x, x * y, y * y, x * rest, y * rest, rest * rest, 1 + 0 * x)
        )
        firm = np.float32(FIRMNESS)
        det = (xx + firm) * (yy + firm) - xy * xy
        step = np.stack([-((yy + firm) * xr - xy * yr) / det, -((xx + firm) * yr - xy * xr) / det])
        flow = np.clip(flow + np.clip(step, -1.0, 1.0), -LONGEST_FLOW, LONGEST_FLOW)
    at = _cells(points, surface)
    places = at + _read(flow.transpose(1, 2, 0), at)
    pixels = view.project(grid, rotation, translation)
    half = 0.5 * np.eye(2)
    # Pixels by columns and rows, (J, 2, 2).
    slope = np.stack([_read(pixels, places + side) - _read(pixels, places - side) for side in half], axis=2)
    xx, xy, yy, rr, mass, correlation, known = _read(
        np.stack([xx, xy, yy, rr, mass, agreement_of(seen, texture, common)[0], common], axis=-1), at
    ).T
    information = np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1) * FLOW_WINDOW**2 / OVERLAP
    noise = rr / np.maximum(mass, 1e-3) + LEAST_NOISE
    scatter = noise[:, None, None] * np.linalg.inv(information + 1e-3 * np.eye(2)) + FLOW_SD**2 * np.eye(2)
    good = (correlation > AGREES) & (known > SEEN) & (np.abs(np.linalg.det(slope)) > 1e-3)
    whiten = np.zeros((len(points), 2, 2))
    root = np.linalg.cholesky(np.linalg.inv(scatter[good])).transpose(0, 2, 1)
    whiten[good] = root @ np.linalg.inv(slope[good])
    return _read(pixels, places), whiten


def _cells(points: Array, surface: Surface) -> Array:
    """Column and row of places on the finest grid."""
    angle = np.degrees(np.arctan2(points[:, 0], points[:, 2]))
    across = (angle / HALF_ANGLE_DEG + 1.0) / 2.0
    down = (points[:, 1] - surface.top_mm) / (surface.bottom_mm - surface.top_mm)
    return np.stack([across, down], axis=1) * FINEST - 0.5


def _read(values: Array | Map, at: Array) -> Array:
    """Values (J, C) of a map (H, W, C) at columns and rows (J, 2), bilinear."""
    last = np.array(values.shape[1::-1]) - 1
    at = np.clip(at, 0, last)
    column, row = np.minimum(at.astype(int), last - 1).T
    across, down = (at - np.stack([column, row], axis=1)).T[..., None]
    upper = values[row, column] * (1 - across) + values[row, column + 1] * across
    lower = values[row + 1, column] * (1 - across) + values[row + 1, column + 1] * across
    return np.asarray(upper * (1 - down) + lower * down)
