"""The skin of ICT-FaceKit as a face of its own, its lips told apart by the slit between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.geometry import Array
from evalkit.head import Head, Jaw
from evalkit.head.ict import SOURCE, blendshapes, ict_face
from evalkit.head.model import Indices
from evalkit.head.proportions import JAW_AXIS
from evalkit.synthetic.layouts import PAPER_23

LIP_MM = 9.0
"""The lips are the skin so near, over the surface, to the outline landmarks of the mouth and those within it."""

NECK_MM, REAR_MM = -105.0, 0.0
"""Below this height is the neck; behind this depth is the rear of the head."""


def skin_of_ict(path: str | Path) -> Head:
    """Face and neck of ICT-FaceKit, all its expressions as blendshapes.

    Parameters
    ----------
    path : str or Path
        As :func:`evalkit.head.ict.ict_face` takes it.

    Returns
    -------
    Head

    Raises
    ------
    EvalkitError
        If there is no such file, or it holds something else.
    """
    face = ict_face(Path(path))
    vertices = face.vertices[: face.parts["head_and_neck"][1]]
    triangles = face.triangles[(face.triangles < len(vertices)).all(axis=1)]
    regions = _regions(vertices, triangles, face.landmarks, face.parts["face"][1])
    return Head(
        name="ict",
        vertices=vertices,
        triangles=triangles,
        parts={"skin": (0, len(triangles))},
        regions=regions,
        landmarks={
            "mouth corner right": vertices[face.landmarks[48]],
            "mouth corner left": vertices[face.landmarks[54]],
        },
        marker_sites=_sites(vertices, regions),
        jaw=Jaw(JAW_AXIS, np.zeros(len(vertices))),
        blendshapes=blendshapes(face.expressions, vertices),
        source=SOURCE,
    )


def _regions(vertices: Array, triangles: Indices, landmarks: Indices, face: int) -> dict[str, Indices]:
    """A partition of the skin; a lip is where its landmarks are nearer than the other's, over the surface."""
    # Landmarks by their 300-W numbers, from 0: the mouth's outline from 48, that of its opening from 60.
    graph = edge_graph(vertices, triangles)
    upper, lower = (
        edge_distance(graph, landmarks[[*range(a, a + 5), *range(b, b + 3)]]) for a, b in ((49, 61), (55, 65))
    )
    lips = edge_distance(graph, landmarks[48:68]) < LIP_MM
    neck = vertices[:, 1] < NECK_MM
    rear = ~neck & ((np.arange(len(vertices)) >= face) | (vertices[:, 2] < REAR_MM))
    found = {
        "hindbrain": rear & ~lips,
        "neck": neck & ~lips,
        "face": ~(lips | neck | rear),
        "upper lip": lips & (upper <= lower),
        "lower lip": lips & (upper > lower),
    }
    return {name: np.flatnonzero(which) for name, which in found.items()}


def _sites(vertices: Array, regions: dict[str, Indices]) -> dict[str, Array]:
    """Marker sites at their nearest vertices; those of a lip on that lip."""
    out = {}
    for name, place in PAPER_23.items():
        lip = "upper lip" if name.startswith("UpperLip") else "lower lip" if name.startswith("LowerLip") else ""
        allowed = regions[lip] if lip else np.concatenate(list(regions.values()))
        out[name] = vertices[allowed[cKDTree(vertices[allowed]).query(place)[1]]]
    return out
