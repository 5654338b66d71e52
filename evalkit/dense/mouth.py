"""Where the lips of a head touch: the pairs of places that must not pass through each other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.model import Indices

TOUCH_MM = 1.5
"""Lips that are so near each other at rest touch: closed lips of a scan are up to a millimetre apart."""

CORNER_MM = 3.0
"""Over this distance from where the lips grow together there is one skin and nothing to cross."""

STRAIGHT = 0.1
"""So near an end of an edge, as a share of it, the place opposite is the vertex there."""

NEIGHBOURS = 6
"""Vertices of the upper lip between which the place opposite a vertex of the lower lip is looked for."""


@dataclass(frozen=True, eq=False)
class LipContact:
    """Vertices of the lower lip and, opposite each, a place between two vertices of the upper lip.

    Attributes
    ----------
    lower : ndarray of int, shape (P,)
    upper : ndarray of int, shape (P, 2)
    share : ndarray, shape (P,)
        The place is ``(1 - share) v[upper[:, 0]] + share v[upper[:, 1]]``.
    """

    lower: Indices
    upper: Indices
    share: Array


def lip_contact(head: Head) -> LipContact:
    """The contact of the lips at rest; without pairs if they are apart or the head has none."""
    nothing = LipContact(np.zeros(0, dtype=np.intp), np.zeros((0, 2), dtype=np.intp), np.zeros(0))
    upper, lower = (np.asarray(head.regions.get(name, []), dtype=np.intp) for name in ("upper lip", "lower lip"))
    if len(upper) < NEIGHBOURS or not len(lower):
        return nothing
    graph = edge_graph(head.vertices, head.part_triangles(*head.parts))
    member = np.zeros((2, len(head.vertices)), dtype=bool)
    member[0, upper], member[1, lower] = True, True
    beside = [lip | (graph.astype(bool) @ lip > 0) for lip in member]
    from_corner = edge_distance(graph, np.flatnonzero(beside[0] & beside[1]))
    gap, near = cKDTree(head.vertices[upper]).query(head.vertices[lower], k=NEIGHBOURS)
    kept = (gap[:, 0] < TOUCH_MM) & (from_corner[lower] > CORNER_MM)
    if not kept.any():
        return nothing
    lower, near = lower[kept], upper[near[kept]]
    pairs = np.array(list(combinations(range(NEIGHBOURS), 2)))
    first, second = head.vertices[near[:, pairs[:, 0]]], head.vertices[near[:, pairs[:, 1]]]
    along, towards = second - first, head.vertices[lower][:, None] - first
    share = np.clip((towards * along).sum(axis=2) / np.maximum((along**2).sum(axis=2), 1e-12), 0.0, 1.0)
    distance = np.linalg.norm(towards - share[..., None] * along, axis=2)
    best = distance.argmin(axis=1)
    rows = np.arange(len(lower))
    upper, share = near[rows[:, None], pairs[best]], share[rows, best]
    # Where two edges meet straight opposite, neither must be preferred: left and right would differ.
    at_end = np.minimum(share, 1.0 - share) < STRAIGHT
    upper[at_end] = upper[at_end, np.round(share[at_end]).astype(int)][:, None]
    return LipContact(lower, upper, share)
