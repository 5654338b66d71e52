"""Lips that touch and do not go through each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.model import Indices

REACH_MM = 9.0
"""Distance from the edge of a lip over which a correction fades: about the height of a lip."""


@dataclass(frozen=True, eq=False)
class Lips:
    """The edges at which the lips meet, paired from corner to corner, and what moves along with them.

    Attributes
    ----------
    upper, lower : ndarray of int, shape (K,)
        Vertices of the edges, corners excluded, the nearest ones paired.
    moved : ndarray of int, shape (N,)
        Vertices within `REACH_MM` of an edge.
    follow : sparse array, shape (N, K)
        Up for the upper lip, down for the lower one: displacement of a vertex for a unit of overlap at each pair.
    """

    upper: Indices
    lower: Indices
    moved: Indices
    follow: csr_array


def find_lips(head: Head) -> Lips | None:
    """The lips of a head whose mouth is cut open and lined; None for one without.

    The edge of a lip is where the skin goes over into the mouth's lining.
    """
    rim = np.intersect1d(head.part_vertices("skin"), head.part_vertices("mouth pocket"))
    edges = [np.intersect1d(rim, head.regions.get(name, rim[:0])) for name in ("upper lip", "lower lip")]
    if min(len(edge) for edge in edges) < 3:
        return None
    upper, lower = (edge[np.argsort(head.vertices[edge, 0], kind="stable")] for edge in edges)
    inner = slice(1, -1)
    longer, shorter = (upper, lower) if len(upper) >= len(lower) else (lower, upper)
    longer = longer[inner]
    partner = shorter[np.abs(head.vertices[longer, 0][:, None] - head.vertices[shorter, 0]).argmin(axis=1)]
    # Where both lips end in one vertex, the corner, there is nothing to keep apart.
    apart = longer != partner
    pair = (longer[apart], partner[apart])
    upper, lower = pair if len(edges[0]) >= len(edges[1]) else pair[::-1]
    soft = head.soft_vertices
    parts, rows = [], []
    for edge, name, way in ((upper, "upper lip", 0.5), (lower, "lower lip", -0.5)):
        own = np.intersect1d(soft, head.regions[name])
        gap = np.linalg.norm(head.vertices[own][:, None] - head.vertices[edge], axis=2)
        near = gap.min(axis=1) < REACH_MM
        own, gap = own[near], gap[near]
        # By nearness along the edge, so that an edge vertex itself gets its own correction nearly alone.
        share = 1.0 / (gap**2 + 0.25)
        share /= share.sum(axis=1, keepdims=True)
        fade = 1.0 - gap.min(axis=1) / REACH_MM
        parts.append(own)
        rows.append(way * share * (fade * fade * (3.0 - 2.0 * fade))[:, None])
    return Lips(upper, lower, np.concatenate(parts), csr_array(np.concatenate(rows)))


def overlap(lips: Lips, vertices: Array) -> Array:
    """How far the lower edge is above the upper one at each pair, mm, shape (F, K); negative where they are apart."""
    return vertices[:, lips.lower, 1] - vertices[:, lips.upper, 1]


def part_lips(lips: Lips, vertices: Array, at_rest: Array, rounds: int = 3) -> None:
    """Move lips that went through each other back to where they touch, in place, vertices (F, V, 3), mm.

    Each lip gives way by half of the overlap, with everything within `REACH_MM` of its edge. What the head itself
    has at rest, (K,), is no overlap.
    """
    for _ in range(rounds):
        through = np.maximum(overlap(lips, vertices) - np.maximum(at_rest, 0.0), 0.0)
        frames = np.flatnonzero(through.max(axis=1, initial=0.0) > 1e-3)
        if not frames.size:
            return
        shift = (lips.follow @ through[frames].T).T
        vertices[frames[:, None], lips.moved, 1] += shift
