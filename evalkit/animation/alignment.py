"""A performer's markers laid over a head: the similarity between them, and markers placed by position.

The displacements that drive a head are measured in its axes, so the performer is turned, moved and scaled onto the
head's marker sites first. Markers without a site of their own are put where they then come to lie.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, nearest_rotation
from evalkit.head import Head
from evalkit.head.mesh import closest_points

OFF_SKIN_MM = 20.0
"""A marker that comes to lie further from the head's skin is on no skin: a helmet, a microphone, a shoulder."""

APART_MM = 5.0
"""Nearer to another centre a placed marker adds nothing but the difference of two noises."""

WORST_MATCH_MM = 12.0
"""Root-mean-square distance between sites and markers assigned by position: two faces of any proportions agree
better, other parts of the body do not."""

ROUNDS = 50


@dataclass(frozen=True, eq=False)
class Alignment:
    """A similarity ``h = scale * rotation @ (p - performer) + head`` from the performer's axes to the head's.

    Attributes
    ----------
    scale : float
    rotation : ndarray, shape (3, 3)
    performer, head : ndarray, shape (3,), mm
        Middles of the markers on both.
    residual_mm : float
        Root-mean-square distance that is left.
    """

    scale: float
    rotation: Array
    performer: Array
    head: Array
    residual_mm: float

    def points(self, places: ArrayLike) -> Array:
        """Positions (..., 3) in the head's axes and size, mm."""
        return self.scale * self.directions(np.asarray(places) - self.performer) + self.head

    def directions(self, vectors: ArrayLike) -> Array:
        """Vectors (..., 3) in the head's axes, their lengths kept."""
        return np.asarray(vectors, dtype=np.float64) @ self.rotation.T

    def motion(self, rotations: Array, translations: Array) -> tuple[Array, Array]:
        """Head motion ``x = R P + T`` of the performer as motion of the head, (F, 3, 3) and (F, 3) mm."""
        turned = self.rotation @ rotations @ self.rotation.T
        moved = rotations @ self.performer + translations - self.performer
        return turned, self.head + self.scale * self.directions(moved) - turned @ self.head


def align(performer: ArrayLike, head: ArrayLike) -> Alignment:
    """The similarity that brings points (N, 3) of a performer nearest to those of a head.

    Raises
    ------
    EvalkitError
        If there are fewer than three points, or they are in one line.

    References
    ----------
    Umeyama, IEEE TPAMI 13(4), 1991, doi:10.1109/34.88573.
    """
    p, h = np.asarray(performer, dtype=np.float64), np.asarray(head, dtype=np.float64)
    a, b = p - p.mean(axis=0), h - h.mean(axis=0)
    spread = np.linalg.svd(a, compute_uv=False) if len(a) >= 3 else np.zeros(3)
    # A tenth of a millimetre of breadth for every 10 mm of length is noise of a line, not a plane.
    if spread[1] <= 0.01 * spread[0] or spread[0] == 0.0:
        raise EvalkitError(
            f"{len(p)} markers at rest do not show how the face is turned: at least three that are not in one line"
        )
    cross = b.T @ a
    rotation = nearest_rotation(cross)
    scale = float(np.sum(rotation * cross) / np.sum(a * a))
    left = b - scale * a @ rotation.T
    return Alignment(scale, rotation, p.mean(axis=0), h.mean(axis=0), float(np.sqrt(np.mean(np.sum(left**2, axis=1)))))


def match_positions(places: Array, axes: Array, sites: Mapping[str, Array]) -> dict[str, int]:
    """Marker site -> index of the marker on it, found by position alone.

    Sites and markers are assigned one to one with the smallest sum of distances, the similarity between them is
    fitted again, and so on until nothing changes.

    Parameters
    ----------
    places : ndarray, shape (M, 3), mm
        The performer's markers at rest.
    axes : ndarray, shape (3, 3)
        Rows: the performer's left, up and forward in the axes of `places`, to some 30 degrees.
    sites : mapping of str to ndarray, shape (3,), mm

    Raises
    ------
    EvalkitError
        If the markers do not lie like those of a face.

    Notes
    -----
    The assignment is that of [1]_ as SciPy solves it.

    References
    ----------
    .. [1] Crouse, IEEE TAES 52(4), 2016, doi:10.1109/TAES.2016.140952.
    """
    from scipy.optimize import linear_sum_assignment

    names, targets = list(sites), np.array(list(sites.values()))
    centred, wanted = places - places.mean(axis=0), targets - targets.mean(axis=0)
    size = np.linalg.norm(wanted) / np.sqrt(len(wanted)) / max(np.linalg.norm(centred) / np.sqrt(len(centred)), 1e-9)
    lying = size * centred @ axes.T + targets.mean(axis=0)
    rows = columns = np.zeros(0, dtype=np.intp)
    found = None
    for _ in range(ROUNDS):
        gaps = np.linalg.norm(targets[:, None] - lying[None], axis=2)
        now_rows, now_columns = linear_sum_assignment(gaps)
        if np.array_equal(now_columns, columns) and np.array_equal(now_rows, rows):
            break
        rows, columns = now_rows, now_columns
        near = np.argsort(gaps[rows, columns])[: max(4, round(0.8 * len(rows)))]
        found = align(places[columns[near]], targets[rows[near]])
        lying = found.points(places)
    if found is None or len(rows) < 4 or found.residual_mm > WORST_MATCH_MM:
        off = "" if found is None else f" ({found.residual_mm:.0f} mm from the sites of the head, rms)"
        raise EvalkitError(f"the markers do not lie like those of a face{off}; name them with --map Label=Site,...")
    off_site = np.linalg.norm(lying[columns] - targets[rows], axis=1)
    return {
        names[row]: int(column)
        for row, column, off in zip(rows, columns, off_site, strict=True)
        if off <= OFF_SKIN_MM
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Placed:
    """Where a marker without a site was put.

    Attributes
    ----------
    label : str
    position : ndarray, shape (3,), mm
        On the head's skin.
    off_skin_mm : float
        How far from the skin it came to lie.
    reason : str
        Why it is not used, empty if it is.
    """

    label: str
    position: Array
    off_skin_mm: float
    reason: str


def place_others(
    head: Head, alignment: Alignment, known: Mapping[str, tuple[Array, Array]], others: Mapping[str, Array]
) -> list[Placed]:
    """Put markers without a site on the head's skin.

    What the similarity leaves between the known markers and their sites, the other proportions of the performer,
    is interpolated to the others before they are moved to the nearest point of the skin.

    Parameters
    ----------
    head : Head
    alignment : Alignment
    known : mapping of str to (ndarray (3,), ndarray (3,))
        Performer's position at rest and place on the head of the markers that have a site, mm.
    others : mapping of str to ndarray, shape (3,), mm
        The performer's positions at rest.
    """
    from scipy.interpolate import RBFInterpolator

    if not others:
        return []
    lying = alignment.points(np.array([performer for performer, _ in known.values()]))
    sites = np.array([place for _, place in known.values()])
    wanted = alignment.points(np.array(list(others.values())))
    wanted = wanted + RBFInterpolator(lying, sites - lying, kernel="linear", degree=0)(wanted)
    on_skin, _ = closest_points(wanted, head.vertices, head.part_triangles("skin", "lids"))
    off = np.linalg.norm(on_skin - wanted, axis=1)
    taken, placed = list(sites), []
    for label, place, distance in zip(others, on_skin, off, strict=True):
        nearest = float(np.linalg.norm(np.array(taken) - place, axis=1).min())
        reason = ""
        if distance > OFF_SKIN_MM:
            reason = f"{distance:.0f} mm off the skin"
        elif nearest < APART_MM:
            reason = f"{nearest:.1f} mm from another marker"
        else:
            taken.append(place)
        placed.append(Placed(label, place, float(distance), reason))
    return placed
