"""What is wrong with a head, one line each."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from evalkit.geometry import Array
from evalkit.head.mesh import closest_points, components, directed_edges, triangle_normals
from evalkit.head.model import REGIONS, Head, Indices
from evalkit.head.places import NEEDED_LANDMARKS

OFF_SURFACE_MM = 1.0
"""A landmark or marker site further from the skin than that is not on it: about what a marker's base measures."""

SMALLEST_AREA_MM2 = 1e-6
"""Triangles below are taken as degenerate: nothing of that size can be seen, and its normal is rounding."""


def check_head(head: Head) -> list[str]:
    """Everything that would keep a head from being used, in words.

    Parameters
    ----------
    head : Head

    Returns
    -------
    list of str
        One line per problem; empty for a sound head.
    """
    indices = _indices(head)
    if indices:
        return indices
    bad = np.flatnonzero(~np.isfinite(head.vertices).all(axis=1))
    if len(bad):
        return [f"{_some(bad)} of {len(head.vertices)} vertices are not finite numbers"]
    return [*_surface(head), *_places(head), *_regions(head), *_motion(head)]


def _some(which: Indices, most: int = 3) -> str:
    names = ", ".join(str(k) for k in which[:most])
    return f"{len(which)} ({names}{', ...' if len(which) > most else ''})"


def _indices(head: Head) -> list[str]:
    if not len(head.vertices) or not len(head.triangles):
        return ["the mesh is empty"]
    wrong = np.flatnonzero(((head.triangles < 0) | (head.triangles >= len(head.vertices))).any(axis=1))
    if len(wrong):
        return [f"triangles {_some(wrong)} use vertices that do not exist"]
    ends = sorted(head.parts.values())
    if not ends or ends[0][0] != 0 or ends[-1][1] != len(head.triangles):
        return ["the parts do not cover all triangles"]
    if any(a[1] != b[0] for a, b in pairwise(ends)):
        return ["the parts overlap or leave triangles out"]
    if "skin" not in head.parts:
        return ["there is no part named 'skin'"]
    return []


def _surface(head: Head) -> list[str]:
    out = []
    soft = head.part_triangles("skin", "lids", "mouth pocket")
    area = 0.5 * np.linalg.norm(triangle_normals(head.vertices, head.triangles), axis=1)
    flat = np.flatnonzero(area < SMALLEST_AREA_MM2)
    if len(flat):
        out.append(f"triangles {_some(flat)} are degenerate (less than {SMALLEST_AREA_MM2:g} mm²)")
    edges = directed_edges(soft)
    _, inverse, counts = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    crowded = np.unique(edges[counts[inverse.ravel()] > 2])
    if len(crowded):
        out.append(f"the skin is not manifold: more than two triangles share an edge at vertices {_some(crowded)}")
    same, counts = np.unique(edges, axis=0, return_counts=True)
    flipped = np.unique(same[counts > 1])
    if len(flipped) and not len(crowded):
        out.append(f"neighbouring triangles face opposite ways (flipped) at vertices {_some(flipped)}")
    count, label = components(soft)
    if count > 1:
        sizes = np.sort(np.bincount(label))[::-1]
        out.append(f"the skin falls into {count} components of {', '.join(str(n) for n in sizes[:4])} triangles")
    out += _inside_out(head, soft)
    return out


def _inside_out(head: Head, soft: Indices) -> list[str]:
    normals = triangle_normals(head.vertices, soft)
    away = head.vertices[soft].mean(axis=1) - head.vertices[np.unique(soft)].mean(axis=0)
    # Of a head that is the right way round most of the area faces away from its middle.
    if (np.sign((normals * away).sum(axis=1)) * np.linalg.norm(normals, axis=1)).sum() < 0:
        return ["the skin is inside out: its triangles go clockwise as seen from outside"]
    return []


def _places(head: Head) -> list[str]:
    out = []
    missing = [name for name in NEEDED_LANDMARKS if name not in head.landmarks]
    if missing:
        out.append(f"missing landmarks: {', '.join(missing)}")
    skin = head.part_triangles("skin", "lids")
    for kind, places in (("landmark", head.landmarks), ("marker site", head.marker_sites)):
        if not places:
            continue
        positions = np.array(list(places.values()))
        lost = ~np.isfinite(positions).all(axis=1)
        out += [f"{kind} {name} has no position" for name, bad in zip(places, lost, strict=True) if bad]
        distance = np.zeros(len(positions))
        distance[~lost] = closest_points(positions[~lost], head.vertices, skin)[1]
        out += [
            f"{kind} {name} is {d:.1f} mm off the skin"
            for name, d in zip(places, distance, strict=True)
            if d > OFF_SURFACE_MM
        ]
    return out


def _regions(head: Head) -> list[str]:
    unknown = [name for name in head.regions if name not in REGIONS]
    if unknown:
        return [f"unknown regions: {', '.join(unknown)}; known are {', '.join(REGIONS)}"]
    count = np.zeros(len(head.vertices), dtype=int)
    for name, which in head.regions.items():
        if len(which) and (which.min() < 0 or which.max() >= len(head.vertices)):
            return [f"region {name} uses vertices that do not exist"]
        np.add.at(count, which, 1)
    out = [f"region {name} is missing or empty" for name in REGIONS if not len(head.regions.get(name, ()))]
    soft = head.soft_vertices
    nowhere, twice = soft[count[soft] == 0], np.flatnonzero(count > 1)
    if len(nowhere):
        out.append(f"the regions are no partition: vertices {_some(nowhere)} of the skin are in none")
    if len(twice):
        out.append(f"the regions are no partition: vertices {_some(twice)} are in several")
    return out


def _motion(head: Head) -> list[str]:
    out = []
    per_vertex: dict[str, Array] = {}
    if head.jaw is not None:
        per_vertex["jaw weights"] = head.jaw.weights
        if (
            len(head.jaw.weights) == len(head.vertices)
            and not ((head.jaw.weights >= 0) & (head.jaw.weights <= 1)).all()
        ):
            out.append("jaw weights are not between 0 and 1")
    if head.lids is not None:
        per_vertex |= {"lid angles": head.lids.turn, "lid lifts": head.lids.lift}
    if head.uv is not None:
        per_vertex["texture coordinates"] = head.uv
    return out + [
        f"{len(values)} {name} for {len(head.vertices)} vertices"
        for name, values in per_vertex.items()
        if len(values) != len(head.vertices)
    ]
