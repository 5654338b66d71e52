"""ICT-FaceKit's neutral face and expressions as a head with named shapes, from an ``.npz`` of its arrays.

R. Li et al., "Learning Formation of Physically-Based Face Attributes", CVPR 2020; ICT-FaceKit,
https://github.com/ICT-VGL/ICT-FaceKit, MIT licence. The face is read where a user has it; none of it is in here.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head, Jaw
from evalkit.head.model import Indices
from evalkit.head.proportions import JAW_AXIS
from evalkit.synthetic.layouts import PAPER_23

LIP_MM = 9.0
"""The lips are the skin so near, over the surface, to the outline landmarks of the mouth and those within it."""

NECK_MM, REAR_MM = -105.0, 0.0
"""Below this height is the neck; behind this depth is the rear of the head."""


def read_ict(path: str | Path) -> Head:
    """Face and neck of ICT-FaceKit, all its expressions as blendshapes.

    Parameters
    ----------
    path : str or Path
        An ``.npz`` with ``neutral`` (N, 3) and ``expressions`` (E, N, 3) in cm, ``expression_names``, ``quads``,
        ``triangles``, and as JSON ``parts`` and ``vertex_indices``.

    Returns
    -------
    Head

    Raises
    ------
    EvalkitError
        If there is no such file, or it holds something else.
    """
    path = Path(path)
    if not path.is_file():
        raise EvalkitError(f"{path}: no such file")
    try:
        with np.load(path, allow_pickle=False) as data:
            parts = json.loads(str(data["parts"]))
            landmarks = np.array(json.loads(str(data["vertex_indices"]))["idx_to_landmark_verts"])
            count = parts["head_and_neck"][1]
            vertices = 10.0 * data["neutral"][:count].astype(np.float64)
            quads, more = (data[name][(data[name] < count).all(axis=1)] for name in ("quads", "triangles"))
            shapes = 10.0 * data["expressions"][:, :count].astype(np.float64) - vertices
            names = [str(name) for name in data["expression_names"]]
    except Exception as error:
        # A zip that is cut short or something else altogether: numpy raises a dozen different errors.
        raise EvalkitError(
            f"{path}: not ICT-FaceKit arrays ({type(error).__name__}: {error})".splitlines()[0]
        ) from error
    triangles = np.vstack([quads[:, :3], quads[:, [0, 2, 3]], more]).astype(np.intp)
    regions = _regions(vertices, triangles, landmarks, parts["face"][1])
    moved = {name: np.flatnonzero(np.abs(shape).max(axis=1) > 1e-4) for name, shape in zip(names, shapes, strict=True)}
    return Head(
        name="ict",
        vertices=vertices,
        triangles=triangles,
        parts={"skin": (0, len(triangles))},
        regions=regions,
        landmarks={"mouth corner right": vertices[landmarks[48]], "mouth corner left": vertices[landmarks[54]]},
        marker_sites=_sites(vertices, regions),
        jaw=Jaw(JAW_AXIS, np.zeros(len(vertices))),
        blendshapes={name: (moved[name], shape[moved[name]]) for name, shape in zip(names, shapes, strict=True)},
        source="ICT-FaceKit, MIT licence, Copyright (c) 2020 USC Institute for Creative Technologies",
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
