"""Heads of others: a mesh file with a JSON of names, ICT-FaceKit, the canonical face of MediaPipe.

The JSON beside a mesh (or named with ``--names``) holds::

    {
      "unit_mm": 10.0,
      "landmarks": {"nose tip": 1225, "chin": [0.0, -75.7, 104.3]},
      "marker_sites": {"Chin": 1307},
      "regions": {"neck": [12, 13], "upper lip": [40, 41], "lower lip": [50, 51], "hindbrain": [1, 2]},
      "parts": {"skin": [0, 1000], "eyeballs": [1000, 1400]}
    }

``unit_mm`` is the length of the file's unit (1 if left out). A place is a vertex number or a position in the
file's unit. Vertices that no region names belong to the face. ``parts`` are ranges of triangles; without them
everything is skin.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.model import REGIONS, SOFT, Head, Indices

MESH_ENDINGS = (".obj", ".ply", ".stl", ".vtk", ".vtp", ".glb", ".gltf")


def import_head(source: str | Path, names: str | Path | None = None) -> Head:
    """A head from a mesh file of others.

    Parameters
    ----------
    source : str or Path
        A mesh file (OBJ, PLY, STL, VTK, glTF) with a JSON of names; the ICT-FaceKit subset (``.npz``); the
        folder of ICT-FaceKit with ``generic_neutral_mesh.obj``; ``mediapipe_canonical_face.obj``.
    names : str or Path, optional
        JSON of landmarks and regions; by default the file beside the mesh with the ending ``.json``.

    Returns
    -------
    Head

    Raises
    ------
    EvalkitError
        If a file cannot be read or names something that is not there.
    """
    path = Path(source)
    if not path.exists():
        raise EvalkitError(f"{path}: no such file or folder")
    if path.is_dir() or path.suffix == ".npz":
        from evalkit.head.ict import read_ict

        return read_ict(path)
    if path.suffix.lower() not in MESH_ENDINGS:
        raise EvalkitError(f"{path}: '{path.suffix}' is no mesh file; known are {', '.join(MESH_ENDINGS)}")
    vertices, triangles = read_mesh(path)
    if path.name == "mediapipe_canonical_face.obj" and names is None:
        return _canonical_face(path, vertices, triangles)
    beside = path.with_suffix(".json") if names is None else Path(names)
    return with_names(path, vertices, triangles, read_names(beside))


def read_mesh(path: Path) -> tuple[Array, Indices]:
    """Vertices (V, 3) in the file's unit and triangles (T, 3) of a mesh file.

    Raises
    ------
    EvalkitError
        If the file cannot be read or holds no surface.
    """
    import pyvista

    try:
        data = pyvista.read(path)
        blocks = list(data.recursive_iterator(skip_none=True)) if isinstance(data, pyvista.MultiBlock) else [data]
        surfaces = [block.triangulate() for block in blocks if isinstance(block, pyvista.PolyData) and block.n_cells]
    except Exception as error:
        # The readers behind raise whatever they like on a damaged file.
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise EvalkitError(f"{path}: cannot be read as a mesh ({reason})") from error
    # Joined by hand: the library's own ways to do it renumber the vertices, which the names refer to.
    vertices, triangles, count = [], [], 0
    for surface in surfaces:
        vertices.append(np.asarray(surface.points, dtype=np.float64))
        triangles.append(np.asarray(surface.faces).reshape(-1, 4)[:, 1:].astype(np.intp) + count)
        count += surface.n_points
    if not count:
        raise EvalkitError(f"{path}: holds no triangles")
    return np.concatenate(vertices), np.concatenate(triangles)


def read_names(path: Path) -> dict[str, Any]:
    """The JSON of names.

    Raises
    ------
    EvalkitError
        If it is missing or no JSON object.
    """
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise EvalkitError(
            f"{path}: cannot be read ({error.strerror or error}); a mesh needs a JSON of landmarks and regions"
        ) from error
    except ValueError as error:
        raise EvalkitError(f"{path}: no valid JSON ({error})") from error
    if not isinstance(facts, dict) or not isinstance(facts.get("landmarks"), dict):
        raise EvalkitError(f"{path}: 'landmarks' is missing: an object of names and vertex numbers or positions")
    return facts


def with_names(path: Path, vertices: Array, triangles: Indices, facts: dict[str, Any]) -> Head:
    """A head of a mesh and its JSON of names.

    Raises
    ------
    EvalkitError
        If a name stands for a vertex that does not exist or for no position.
    """
    try:
        unit = float(facts.get("unit_mm", 1.0))
        parts = {
            str(name): (int(a), int(b)) for name, (a, b) in facts.get("parts", {"skin": (0, len(triangles))}).items()
        }
    except (TypeError, ValueError, AttributeError) as error:
        raise EvalkitError(f"{path}: 'unit_mm' must be a number and 'parts' names with [first, end]") from error

    def places(kind: str) -> dict[str, Array]:
        out = {}
        for name, value in facts.get(kind, {}).items():
            if isinstance(value, int):
                if not 0 <= value < len(vertices):
                    raise EvalkitError(f"{path}: {kind} '{name}' is vertex {value}, of {len(vertices)}")
                out[name] = vertices[value] * unit
            elif isinstance(value, list) and len(value) == 3 and all(isinstance(x, int | float) for x in value):
                out[name] = np.array(value, dtype=np.float64) * unit
            else:
                raise EvalkitError(f"{path}: {kind} '{name}' is neither a vertex number nor a position [x, y, z]")
        return out

    regions = {}
    for name, which in facts.get("regions", {}).items():
        index = np.unique(np.asarray(which, dtype=np.float64)).astype(np.intp) if which else np.zeros(0, np.intp)
        if len(index) and (index[0] < 0 or index[-1] >= len(vertices)):
            raise EvalkitError(f"{path}: region '{name}' uses vertex {index[-1]}, of {len(vertices)}")
        regions[name] = index
    head = Head(
        name=path.stem,
        vertices=vertices * unit,
        triangles=triangles,
        parts=parts,
        regions={},
        landmarks=places("landmarks"),
        marker_sites=places("marker_sites"),
        source=f"imported from {path.name}",
    )
    return _completed(head, regions)


def _completed(head: Head, regions: dict[str, Indices]) -> Head:
    """The head with every soft vertex in a region: what none names is face."""
    from dataclasses import replace

    soft = np.unique(np.concatenate([head.triangles[slice(*head.parts[p])].ravel() for p in SOFT if p in head.parts]))
    named = np.unique(np.concatenate([np.zeros(0, np.intp), *regions.values()]))
    face = np.union1d(regions.get("face", np.zeros(0, np.intp)), np.setdiff1d(soft, named))
    complete = {name: np.intersect1d(regions.get(name, np.zeros(0, np.intp)), soft) for name in REGIONS}
    return replace(
        head,
        regions=complete
        | {"face": np.intersect1d(face, soft)}
        | {name: which for name, which in regions.items() if name not in REGIONS},
    )


def regions_by_place(vertices: Array, triangles: Indices, landmarks: dict[str, Array]) -> dict[str, Indices]:
    """The five regions of a head that names none, from its landmarks (mm, y up, z forward).

    Lips: within 0.62 mouth widths of the middle of the mouth and between the base of the nose and the fold
    under the lip, told apart by the shorter way along the surface to the middle of either lip. Neck: below the
    chin and behind it. Hindbrain: behind the outer corners of the eyes by one face depth (outer eye corner to nose
    tip), or above the forehead.
    """
    from evalkit.deform.surface import edge_distance, edge_graph, nearest_vertices

    corner = np.array([landmarks["mouth corner left"], landmarks["mouth corner right"]])
    middle, width = corner.mean(axis=0), np.linalg.norm(corner[0] - corner[1])
    eye = 0.5 * (landmarks["eye outer left"] + landmarks["eye outer right"])
    depth = landmarks["nose tip"][2] - eye[2]
    height = landmarks["nasion"][1] - landmarks["chin"][1]
    x, y, z = vertices[:, 0] - middle[0], vertices[:, 1], vertices[:, 2]
    fold = 0.5 * (landmarks["lower lip"][1] + landmarks["chin"][1]) + 0.15 * height
    lips = (np.abs(x) < 0.62 * width) & (z > middle[2] - depth) & (y < landmarks["subnasale"][1]) & (y > fold)
    kind = np.full(len(vertices), 2)
    kind[(z < eye[2] - 1.2 * depth) | (y > landmarks["nasion"][1] + 0.62 * height)] = 0
    kind[(y < landmarks["chin"][1] + 0.03 * height) & (z < landmarks["chin"][2] - 0.4 * depth)] = 1
    kind[y < landmarks["chin"][1] - 0.1 * height] = 1
    # Not by height: where lips are full or curved, the edge of one lies above the corners or below them.
    graph = edge_graph(vertices, triangles)
    middles, _ = nearest_vertices(vertices, np.array([landmarks["upper lip"], landmarks["lower lip"]]))
    to_upper, to_lower = (edge_distance(graph, [vertex]) for vertex in middles)
    kind[lips & (to_upper <= to_lower)] = 3
    kind[lips & (to_upper > to_lower)] = 4
    return {name: np.flatnonzero(kind == k) for k, name in enumerate(REGIONS)}


def head_by_landmarks(
    head_name: str, vertices: Array, triangles: Indices, landmarks: dict[str, Array], **other: Any
) -> Head:
    """A head whose regions and marker sites follow from its landmarks."""
    from evalkit.head.places import on_skin, sites_by_landmarks

    parts = other.pop("parts", {"skin": (0, len(triangles))})
    skin = triangles[slice(*parts["skin"])]
    head = Head(
        name=head_name, vertices=vertices, triangles=triangles, parts=parts, regions={}, landmarks=landmarks,
        marker_sites=on_skin(sites_by_landmarks(landmarks), vertices, skin), **other,
    )  # fmt: skip
    return _completed(head, regions_by_place(vertices, triangles, landmarks))


def _canonical_face(path: Path, vertices: Array, triangles: Indices) -> Head:
    # MakeHuman's head, beside which weights are kept, is imported by this module in turn.
    from evalkit.head.detector import DETECTED
    from evalkit.head.points import LANDMARK_POINTS

    vertices = vertices * 10.0  # the file is in centimetres
    # Pupils are no vertices of the file, and the inner edges of the lips no landmarks of a head.
    landmarks = {name: vertices[k] for name, k in DETECTED.items() if name in LANDMARK_POINTS}
    return head_by_landmarks(path.stem, vertices, triangles, landmarks, source="MediaPipe canonical face, Apache-2.0")
