"""How good a fit to a photo is, in numbers and in words."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from evalkit.geometry import Array
from evalkit.head.mesh import triangle_normals
from evalkit.head.model import Head
from evalkit.head.photo import Photo
from evalkit.head.photo_warp import Similarity, Warp
from evalkit.head.points import INNER_LIPS
from evalkit.head.real_heads import depth_among_real_heads

TURNED_DEG, TILTED_DEG = 10.0, 15.0
"""Estimates of yaw and pitch beyond which a photo counts as not from the front. One face differs from another by some
degrees in these estimates, more in pitch than in yaw; see :func:`turn_in_photo`."""

OPEN_MOUTH = 0.15
"""Gap between the inner edges of the lips, as part of the height of both lips, above which the mouth counts as open."""

SMALL_EYES_PX = 100.0
"""Between the middles of the eyes: below, a pixel of the photo is larger than half a millimetre of the face."""

UNLIKELY_DEPTH = 3.0
"""Standard deviations of real heads' depths."""


@dataclass(frozen=True)
class FitReport:
    """Measures of a fit; :meth:`as_dict` gives them for JSON.

    Attributes
    ----------
    reprojection_rms_px, reprojection_max_px : float, pixels of the photo
        Distance of the fitted head's landmarks, on its skin, from the points given.
    worst_point : str
        With the largest distance.
    points : int
        Landmarks fitted.
    relaxed : float
        Weight of smoothness against the points; 0 where they are followed exactly.
    pixels_per_mm, roll_deg : float
        Of the similarity.
    yaw_deg, pitch_deg : float
        Estimated turn of the face in the photo, to the person's left and upward.
    eyes_px : float
        Between the middles of the eyes.
    mouth_open : float or None
        Gap between the lips as part of their height; None without the points of their inner edges.
    warp_area, warp_angle : dict of str to float
        Percentiles over the face's triangles, weighted by area: how many times as large as the given head's a
        triangle became (in the plane), and how many times as much in one direction as across.
    projection_stretch : dict of str to float
        Percentiles of a triangle's area over its area in the photo: by so much the photo is drawn out on it.
    depth : dict
        Nose tip and chin: see :func:`evalkit.head.real_heads.depth_among_real_heads`.
    status : dict of str to str
        Word -> sentence, for what a user should know: ``relaxed``, ``turned``, ``tilted``, ``mouth open``, ``small``,
        ``depth``.
    """

    reprojection_rms_px: float
    reprojection_max_px: float
    worst_point: str
    points: int
    relaxed: float
    pixels_per_mm: float
    roll_deg: float
    yaw_deg: float
    pitch_deg: float
    eyes_px: float
    mouth_open: float | None
    warp_area: dict[str, float]
    warp_angle: dict[str, float]
    projection_stretch: dict[str, float]
    depth: dict[str, dict[str, float]]
    status: dict[str, str]

    def as_dict(self) -> dict[str, Any]:
        """All measures as numbers, words and lists."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The measures for people."""
        deep = ", ".join(
            f"{name} {facts['off_mm']:+.1f} mm ({facts['score']:+.1f} sd)" for name, facts in self.depth.items()
        )
        return [
            f"{self.points} points followed within {self.reprojection_rms_px:.2f} px rms, "
            f"{self.reprojection_max_px:.2f} at most ({self.worst_point}); {self.pixels_per_mm:.2f} px/mm",
            f"face in the photo: yaw {self.yaw_deg:+.0f}, pitch {self.pitch_deg:+.0f}, roll {self.roll_deg:+.0f} deg",
            f"warp of the given head: area x {self.warp_area['p5']:.2f} to {self.warp_area['p95']:.2f}, one way more "
            f"than the other x {self.warp_angle['p95']:.2f}; photo drawn out x {self.projection_stretch['p95']:.1f}",
            f"depth beside real heads: {deep}",
            *(f"warning: {text}" for text in self.status.values()),
        ]


def report_fit(
    before: Head, fitted: Head, photo: Photo, view: Similarity, warp: Warp, places: dict[str, Array]
) -> FitReport:
    """Measure a fit.

    Parameters
    ----------
    before, fitted : Head
    photo : Photo
    view : Similarity
    warp : Warp
    places : dict of str to ndarray, shape (2,), pixels
        The points given.

    Returns
    -------
    FitReport
    """
    names = [name for name in places if name in fitted.landmarks]
    seen = np.array([places[name] for name in names])
    off = np.linalg.norm(view.to_photo(np.array([fitted.landmarks[name] for name in names])) - seen, axis=1)
    yaw, pitch = turn_in_photo(np.array([before.landmarks[name] for name in names]), seen)
    middle = {
        side: 0.5 * (places[f"eye inner {side}"] + places[f"eye outer {side}"]) for side in ("left", "right")
    }  # fmt: skip
    eyes = float(np.linalg.norm(middle["left"] - middle["right"]))
    mouth = None
    if all(name in places for name in INNER_LIPS):
        gap = np.linalg.norm(places["upper lip inner"] - places["lower lip inner"])
        mouth = float(gap / np.linalg.norm(places["upper lip"] - places["lower lip"]))
    depth = depth_among_real_heads(fitted.landmarks, ("nose tip", "chin"))
    rms = float(np.sqrt((off**2).mean()))
    return FitReport(
        reprojection_rms_px=rms, reprojection_max_px=float(off.max()), worst_point=names[int(off.argmax())],
        points=len(names), relaxed=warp.relaxed, pixels_per_mm=view.pixels_per_mm, roll_deg=view.roll_deg, yaw_deg=yaw,
        pitch_deg=pitch, eyes_px=eyes, mouth_open=mouth, **_stretch(before, fitted), depth=depth,
        status=_status(photo, warp, rms, yaw, pitch, eyes, mouth, depth),
    )  # fmt: skip


def turn_in_photo(landmarks: Array, pixels: Array) -> tuple[float, float]:
    """Yaw to the person's left and pitch upward, degrees, of a face seen orthographically.

    The affine camera from a generic head's landmarks (N, 3), mm, to pixels (N, 2) with the least squares error, and the
    rotation nearest to it. How this face differs from the generic one goes into the estimate.

    References
    ----------
    Hartley & Zisserman, "Multiple View Geometry", 2nd ed. 2004, section 14.2 (affine camera).
    """
    flat = (pixels - pixels.mean(axis=0)) * [1.0, -1.0]
    camera, *_ = np.linalg.lstsq(landmarks - landmarks.mean(axis=0), flat, rcond=None)
    u, _, vt = np.linalg.svd(camera.T, full_matrices=False)
    rows = u @ vt
    # The third row is where the face's depth goes: its direction towards the camera in the head's axes.
    towards = np.cross(rows[0], rows[1])
    return float(np.rad2deg(np.arctan2(-towards[0], towards[2]))), float(np.rad2deg(-np.arcsin(towards[1])))


def _stretch(before: Head, fitted: Head) -> dict[str, dict[str, float]]:
    face = np.concatenate([fitted.regions[name] for name in ("face", "upper lip", "lower lip")])
    skin = fitted.part_triangles("skin", "lids")
    skin = skin[np.isin(skin, face).all(axis=1)]
    normals = triangle_normals(fitted.vertices, skin)
    area = np.linalg.norm(normals, axis=1)
    # What is turned away cannot be seen in the photo.
    seen = normals[:, 2] > 0.05 * area
    skin, area, normals = skin[seen], area[seen], normals[seen]
    old, new = (np.diff(head.vertices[skin][..., :2], axis=1) for head in (before, fitted))
    sigma = np.linalg.svd(np.linalg.solve(old, new), compute_uv=False)
    return {
        "warp_area": _percentiles(sigma.prod(axis=1), area),
        "warp_angle": _percentiles(sigma[:, 0] / sigma[:, 1], area),
        "projection_stretch": _percentiles(area / normals[:, 2], area),
    }


def _percentiles(values: Array, weights: Array) -> dict[str, float]:
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    return {f"p{p}": float(values[order[np.searchsorted(share, p / 100)]]) for p in (5, 50, 95, 99)}


def _status(
    photo: Photo, warp: Warp, rms: float, yaw: float, pitch: float, eyes: float, mouth: float | None,
    depth: dict[str, dict[str, float]],
) -> dict[str, str]:  # fmt: skip
    out = {}
    if warp.relaxed:
        out["relaxed"] = f"the points would fold the face; they are followed only within {rms:.1f} px rms"
    if abs(yaw) > TURNED_DEG:
        out["turned"] = f"the face is turned by about {yaw:+.0f} degrees; take a photo from the front"
    if abs(pitch) > TILTED_DEG:
        out["tilted"] = f"the face looks up or down by about {pitch:+.0f} degrees; take a photo from the front"
    if mouth is not None and mouth > OPEN_MOUTH:
        out["mouth open"] = "the mouth is open; the lips are drawn together over the teeth"
    if eyes < SMALL_EYES_PX:
        out["small"] = (
            f"the eyes are {eyes:.0f} pixels apart in {photo.size[0]} x {photo.size[1]}; the skin will be blurred"
        )
    for name, facts in depth.items():
        if abs(facts["score"]) > UNLIKELY_DEPTH:
            out["depth"] = f"the {name} is {facts['off_mm']:+.1f} mm from where real heads have it"
    return out
