"""Key poses: what the head looked like where its pose was known, to undo drift and to find a lost head again.

A tracker that compares each frame with the one before adds up its errors. References are templates with their poses;
a pose near one of them is registered against it, and its error is that of the one registration, however long the take.
A head that was lost is looked for by matching small pictures of the references all over the frame (normalised
correlation, at a few sizes and tilts); what matches is then registered and judged like any other pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from evalkit.geometry import Array, cross_matrix, rotation_angle, rotation_from_vector
from evalkit.vision.camera import Camera
from evalkit.vision.registration import Template, View
from evalkit.vision.surface import Map, Surface

PATCH_PIXELS = 24
"""Width of a face in the picture that is searched: two eyes, nose and mouth can be told apart, hair by hair cannot."""

SIZES = (0.8, 1.0, 1.25)
TILTS_DEG = (-20.0, 0.0, 20.0)
LEAST_MATCH = 0.35
"""Correlation below which a match is not worth a registration."""

FACE_SHARE = 0.55
"""The patch takes this share of the radius to both sides and up and down: no hair, no background."""

DEPTH_DEG = 60.0
"""A change of distance by a factor e counts like a turn of this many degrees."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A pose and what was seen in it.

    Attributes
    ----------
    number : int
        Of the frame.
    view : View
        The frame, reduced to what is read of it.
    own : ndarray, shape (H, W), optional
        Weight of what belongs to the face, and not to a hand before it.
    rotation, translation : ndarray
    turn : ndarray, shape (3, 3)
        The rotation against the line of sight.
    template : sequence of Texture
    patch : ndarray, shape (h, w)
        The face in the frame, reduced.
    patch_scale : float
        Pixels of the patch per pixel of the frame.
    """

    number: int
    view: View
    own: Map | None
    rotation: Array
    translation: Array
    turn: Array
    template: Template
    patch: Map
    patch_scale: float

    def moved(self, surface: Surface, rotation: Array, translation: Array) -> Reference:
        """The same frame at a pose and on a surface that are known better."""
        template = self.view.template(surface, rotation, translation, self.own)
        turn = towards(translation).T @ rotation
        return replace(self, rotation=rotation, translation=translation, turn=turn, template=template)


def make_reference(
    number: int,
    view: View,
    surface: Surface,
    camera: Camera,
    rotation: Array,
    translation: Array,
    own: Map | None = None,
) -> Reference:
    """The reference that a frame of that number gives at a pose, if told with a weight (H, W) of what is the face."""
    radius = float(surface.radii_mm.mean())
    middle = camera.project(rotation @ [0.0, 0.0, radius] + translation)
    pixels_per_mm = camera.focal_px / -float(translation[2])
    half = FACE_SHARE * radius * pixels_per_mm
    level = max(0, round(np.log2(max(2 * half / PATCH_PIXELS, 1.0))))
    scale = 1.0 / (1 << level)
    side = max(round(2 * half * scale), 6)
    patch = cv2.getRectSubPix(
        view.picture(level), (side, round(1.3 * side)), tuple(float(x) for x in (middle - 0.5) * scale)
    )
    kept = view.reduced(surface.grids[0], translation)
    template = kept.template(surface, rotation, translation, own)
    turn = towards(translation).T @ rotation
    return Reference(
        number, kept, own, rotation, translation, turn, template, np.asarray(patch, dtype=np.float32), scale
    )


def distances_deg(references: Sequence[Reference], rotation: Array, translation: Array) -> list[float]:
    """How different a pose looks from each reference: the turn against the line of sight, and the change of size."""
    turn = towards(translation).T @ rotation
    apart = np.degrees(rotation_angle(np.stack([reference.turn.T for reference in references]) @ turn))
    sizes = np.log([reference.translation[2] / translation[2] for reference in references])
    return [float(x) for x in apart + DEPTH_DEG * np.abs(sizes)]


def towards(translation: Array) -> Array:
    """Rotation that takes the camera's axis to the line of sight to a place in front of it."""
    x, y, z = translation / np.sqrt(translation @ translation)
    cross = cross_matrix(np.array([y, -x, 0.0]))
    return np.eye(3) + cross + cross @ cross / (1.0 - z)


def search(
    view: View, surface: Surface, camera: Camera, reference: Reference, most: int = 2
) -> list[tuple[Array, Array]]:
    """Poses at which a reference's face may be in a frame, the likeliest first.

    Parameters
    ----------
    view : View
    surface : Surface
    camera : Camera
    reference : Reference
    most : int
        Number of poses.

    Returns
    -------
    list of (ndarray, ndarray)
        Rotation (3, 3) and translation (3,).
    """
    picture = view.picture(round(-np.log2(reference.patch_scale)))
    radius = float(surface.radii_mm.mean())
    front = reference.rotation @ [0.0, 0.0, radius]
    found = []
    for size in SIZES:
        for tilt in TILTS_DEG:
            patch = _turned(reference.patch, size, tilt)
            if patch.shape[0] >= picture.shape[0] or patch.shape[1] >= picture.shape[1]:
                continue
            match = cv2.matchTemplate(picture, patch, cv2.TM_CCOEFF_NORMED)
            _, value, _, (x, y) = cv2.minMaxLoc(match)
            if value < LEAST_MATCH:
                continue
            middle = (np.array([x, y]) + 0.5 * (np.array(patch.shape[::-1]) - 1)) / reference.patch_scale + 0.5
            depth = (reference.translation[2] + front[2]) / size
            ray = np.array([middle[0] - camera.centre_px[0], camera.centre_px[1] - middle[1], -camera.focal_px])
            place = ray * (depth / ray[2])
            seen_from = towards(place) @ towards(reference.translation + front).T
            roll = rotation_from_vector(place / np.linalg.norm(place) * -np.radians(tilt))
            rotation = roll @ seen_from @ reference.rotation
            found.append((float(value), rotation, place - rotation @ [0.0, 0.0, radius]))
    found.sort(key=lambda item: -item[0])
    return [(rotation, translation) for _, rotation, translation in found[:most]]


def _turned(patch: Map, size: float, tilt_deg: float) -> Map:
    """A patch made larger and turned counterclockwise, as seen, without the corners that a turn leaves empty."""
    height, width = patch.shape
    out = (max(round(width * size), 5), max(round(height * size), 5))
    turn = np.array(cv2.getRotationMatrix2D((0.5 * (width - 1), 0.5 * (height - 1)), tilt_deg, size), dtype=np.float64)
    turn[:, 2] += 0.5 * (np.array(out) - 1) - 0.5 * (np.array([width, height]) - 1)
    turned = cv2.warpAffine(patch, turn, out, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return turned.astype(np.float32, copy=False)
