"""ICT-FaceKit's neutral face and expressions as a head with a dense truth, where its data is present."""

from __future__ import annotations

import json

import numpy as np
from contracts.faces import FormulaHead
from realdata import real_data
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from evalkit.deform.surface import edge_graph
from evalkit.synthetic.layouts import PAPER_23


def ict_face():
    """ICT-FaceKit's face and neck with 23 marker sites, lips told apart by the slit, and its expressions (E, V, 3) mm.

    The lips are the skin within 9 mm of the outline landmarks of the mouth and what these enclose.
    """
    data = np.load(real_data("meshes", "ict_facekit_subset.npz"))
    parts = json.loads(str(data["parts"]))
    count = parts["head_and_neck"][1]
    vertices = data["neutral"][:count].astype(float) * 10
    quads = data["quads"][(data["quads"] < count).all(axis=1)]
    more = data["triangles"][(data["triangles"] < count).all(axis=1)]
    triangles = np.vstack([quads[:, :3], quads[:, [0, 2, 3]], more])
    landmarks = np.array(json.loads(str(data["vertex_indices"]))["idx_to_landmark_verts"])
    graph = edge_graph(vertices, triangles)
    upper_inner, lower_inner = landmarks[61:64], landmarks[65:68]
    outline, inner = landmarks[48:60], landmarks[60:68]
    to_lips = dijkstra(graph, indices=np.concatenate([outline, inner]), min_only=True)
    to_upper = dijkstra(graph, indices=np.concatenate([landmarks[49:54], upper_inner]), min_only=True)
    to_lower = dijkstra(graph, indices=np.concatenate([landmarks[55:60], lower_inner]), min_only=True)
    lips = to_lips < 9.0
    neck = vertices[:, 1] < -105.0
    face_only = np.arange(count) < parts["face"][1]
    hind = ~neck & (~face_only | (vertices[:, 2] < 0.0))
    regions = {
        "hindbrain": np.flatnonzero(hind),
        "neck": np.flatnonzero(neck),
        "upper lip": np.flatnonzero(lips & (to_upper <= to_lower)),
        "lower lip": np.flatnonzero(lips & (to_upper > to_lower)),
        "face": np.flatnonzero(~(lips | neck | hind)),
    }
    _, near = cKDTree(vertices).query(np.array(list(PAPER_23.values())))
    sites = dict(zip(PAPER_23, vertices[near], strict=True))
    shapes = data["expressions"][:, :count].astype(float) * 10
    moves = dict(zip((str(name) for name in data["expression_names"]), shapes - vertices, strict=True))
    return FormulaHead(vertices, triangles, sites, regions), moves
