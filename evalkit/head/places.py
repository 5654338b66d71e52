"""Named places of the template: fitting landmarks and marker sites, by where they are seen from the front.

Landmarks are those of the 300-W scheme [1]_ that a person can point at, with their positions on the ICT-FaceKit
neutral face (the vertices that it lists for that scheme), plus the forehead. Marker sites are those of Huang,
Lin & Ouhyoung (2000), Fig. 1(b), placed on the same face.

References
----------
.. [1] C. Sagonas et al., "300 Faces In-The-Wild Challenge", ICCV Workshops 2013, doi:10.1109/ICCVW.2013.59.
"""

from __future__ import annotations

import numpy as np

from evalkit.geometry import Array
from evalkit.head.mesh import closest_points
from evalkit.head.model import Indices

MIDDLE_LANDMARKS: dict[str, tuple[float, float, float]] = {
    "forehead": (0.0, 90.5, 97.5),
    "nasion": (0.0, 37.4, 107.3),
    "nose tip": (0.0, 4.1, 130.7),
    "subnasale": (0.0, -12.0, 115.7),
    "upper lip": (0.0, -24.8, 118.4),
    "lower lip": (0.0, -43.8, 115.5),
    "chin": (0.0, -75.7, 104.3),
}
"""Name -> position, mm. 300-W numbers: 28, 31, 34, 52, 58, 9; the forehead is the skin 53 mm above the nasion."""

PAIRED_LANDMARKS: dict[str, tuple[float, float, float]] = {
    "brow inner": (11.7, 59.1, 107.3),
    "brow middle": (37.9, 62.6, 98.3),
    "brow outer": (58.2, 52.0, 79.1),
    "eye inner": (18.4, 32.5, 92.0),
    "upper lid inner": (27.8, 39.4, 95.3),
    "upper lid outer": (38.7, 38.7, 93.6),
    "eye outer": (44.6, 34.3, 86.0),
    "lower lid outer": (38.6, 30.7, 92.3),
    "lower lid inner": (27.3, 30.8, 94.1),
    "nose wing": (12.5, -11.4, 108.7),
    "lip peak": (7.3, -24.2, 117.3),
    "mouth corner": (25.3, -35.2, 101.9),
    "jaw": (57.2, -44.9, 61.3),
    "ear": (73.6, 36.8, 36.6),
}
"""Name -> position on the left side, mm. 300-W numbers on the left: 23, 25, 27, 43, 44, 45, 46, 47, 48, 36, 53, 55,
13, 17."""

NEEDED_LANDMARKS = (
    "nose tip", "subnasale", "upper lip", "lower lip", "chin", "nasion", "eye inner left", "eye inner right",
    "eye outer left", "eye outer right", "mouth corner left", "mouth corner right",
)  # fmt: skip
"""A head without these can neither be scaled to a performer nor fitted to a photo."""

MARKER_SITES: dict[str, tuple[float, float, float]] = {
    "ForeheadC": (0.0, 104.5, 90.5),
    "ForeheadL": (22.5, 76.5, 100.5),
    "BrowInL": (15.0, 60.0, 107.0),
    "BrowOutL": (47.0, 60.5, 92.0),
    "LidL": (32.0, 40.0, 95.5),
    "NoseBridge": (0.0, 35.5, 108.5),
    "NoseL": (16.0, -6.0, 112.5),
    "CheekL": (45.0, 0.0, 93.5),
    "UpperLipC": (0.0, -23.5, 117.5),
    "UpperLipL": (12.0, -25.0, 115.0),
    "MouthL": (27.0, -35.0, 102.0),
    "LowerLipC": (0.0, -45.5, 113.5),
    "LowerLipL": (13.0, -43.5, 111.5),
    "Chin": (0.0, -65.5, 110.0),
}
"""Label -> position, mm; a label that ends in L has a mirror image that ends in R."""


def all_landmarks() -> dict[str, Array]:
    """Every landmark's position on the measured face; the sides are " left" and " right"."""
    out = {name: np.array(place) for name, place in MIDDLE_LANDMARKS.items()}
    for name, (x, y, z) in PAIRED_LANDMARKS.items():
        out[f"{name} left"], out[f"{name} right"] = np.array([x, y, z]), np.array([-x, y, z])
    return out


def all_marker_sites() -> dict[str, Array]:
    """Every marker's position on the measured face."""
    out = {}
    for label, (x, y, z) in MARKER_SITES.items():
        out[label] = np.array([x, y, z])
        if label.endswith("L"):
            out[label[:-1] + "R"] = np.array([-x, y, z])
    return out


def on_skin(wanted: dict[str, Array], vertices: Array, triangles: Indices) -> dict[str, Array]:
    """Places moved to the nearest point of the skin."""
    found, _ = closest_points(np.array(list(wanted.values())), vertices, triangles)
    return dict(zip(wanted, found, strict=True))


def sites_by_landmarks(landmarks: dict[str, Array]) -> dict[str, Array]:
    """Marker sites near the skin of another head: the measured face's sites carried along with its landmarks.

    An affine map takes the common landmarks of the measured face to those of the head (least squares); what
    it leaves over is spread by inverse distance (Shepard), so that landmarks arrive exactly.
    """
    measured, sites = all_landmarks(), all_marker_sites()
    common = [name for name in measured if name in landmarks]
    source, target = (np.array([where[name] for name in common]) for where in (measured, landmarks))
    wanted = np.array(list(sites.values()))
    one = np.ones((len(source), 1))
    affine, *_ = np.linalg.lstsq(np.hstack([source, one]), target, rcond=None)
    rest = target - np.hstack([source, one]) @ affine
    weight = 1.0 / np.maximum(((wanted[:, None] - source) ** 2).sum(axis=2), 1e-6)
    moved = np.hstack([wanted, np.ones((len(wanted), 1))]) @ affine
    moved += weight @ rest / weight.sum(axis=1, keepdims=True)
    return dict(zip(sites, moved, strict=True))
