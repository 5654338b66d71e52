"""ICT-FaceKit: a realistic head with named expressions and identities, read where a user has it.

R. Li et al., "Learning Formation of Physically-Based Face Attributes", CVPR 2020; https://github.com/ICT-VGL/ICT-FaceKit,
MIT licence. None of it is in here.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.importing import head_by_landmarks, read_mesh
from evalkit.head.model import Head, Indices

SOURCE = "ICT-FaceKit, MIT licence, Copyright (c) 2020 USC Institute for Creative Technologies"

UNIT_MM = 10.0
"""Its files are in centimetres."""

MOVES_MM = 1e-4
"""A vertex that a shape moves by less stays where it is."""

LANDMARKS = {
    "nasion": 28, "nose tip": 31, "subnasale": 34, "upper lip": 52, "lower lip": 58, "chin": 9,
    "brow inner left": 23, "brow inner right": 22, "brow middle left": 25, "brow middle right": 20,
    "brow outer left": 27, "brow outer right": 18, "eye inner left": 43, "eye inner right": 40,
    "upper lid inner left": 44, "upper lid inner right": 39, "upper lid outer left": 45, "upper lid outer right": 38,
    "eye outer left": 46, "eye outer right": 37, "lower lid outer left": 47, "lower lid outer right": 42,
    "lower lid inner left": 48, "lower lid inner right": 41, "nose wing left": 36, "nose wing right": 32,
    "lip peak left": 53, "lip peak right": 51, "mouth corner left": 55, "mouth corner right": 49,
    "jaw left": 13, "jaw right": 5, "ear left": 17, "ear right": 1,
}  # fmt: skip
"""Landmark -> number (from 1) in the 300-W scheme, which ICT-FaceKit lists vertices for."""

PARTS: dict[str, tuple[int, int]] = {
    "face": (0, 9409), "head_and_neck": (9409, 11248), "mouth_socket": (11248, 13294),
    "eye_socket_left": (13294, 13678), "eye_socket_right": (13678, 14062), "gums_and_tongue": (14062, 17039),
    "teeth": (17039, 21451), "eyeball_left": (21451, 23021), "eyeball_right": (23021, 24591),
}  # fmt: skip
"""Ranges of vertices of ICT-FaceKit's mesh, from its documentation; what lies beyond (lashes, lines of the eyes) is
left out."""


class IctFace(NamedTuple):
    """Its arrays.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3), mm
        The neutral face.
    triangles : ndarray of int, shape (T, 3)
    landmarks : ndarray of int, shape (68,)
        Vertices of the 300-W landmarks.
    parts : dict of str to (int, int)
        Ranges of vertices.
    expressions, identities : dict of str to ndarray, shape (V, 3), mm
        Positions, not displacements.
    """

    vertices: Array
    triangles: Indices
    landmarks: Indices
    parts: dict[str, tuple[int, int]]
    expressions: dict[str, Array]
    identities: dict[str, Array]


def ict_face(path: Path) -> IctFace:
    """Arrays of an ``.npz`` of ICT-FaceKit, or of the folder as it is published.

    The ``.npz`` has ``neutral`` (N, 3), ``expressions`` and ``identities`` (E, N, 3) in cm with ``expression_names``
    and ``identity_names``, ``quads``, ``triangles``, and as JSON ``parts`` and ``vertex_indices``.

    Raises
    ------
    EvalkitError
        If there is no such file, or it holds something else.
    """
    if not path.exists():
        raise EvalkitError(f"{path}: no such file or folder")
    return _folder(path) if path.is_dir() else _arrays(path)


def _arrays(path: Path) -> IctFace:
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
        listed = json.loads(str(data["vertex_indices"]))["idx_to_landmark_verts"]
        parts = {name: (int(a), int(b)) for name, (a, b) in json.loads(str(data["parts"])).items()}
        expressions, identities = (
            dict(zip(map(str, data[f"{kind}_names"]), UNIT_MM * data[shapes].astype(np.float64), strict=True))
            for kind, shapes in (("expression", "expressions"), ("identity", "identities"))
        )
        quads, neutral = data["quads"].astype(np.intp), UNIT_MM * data["neutral"].astype(np.float64)
        triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], data["triangles"].astype(np.intp)])
    except Exception as error:
        # numpy, zipfile and json each raise their own kinds of errors on a file that is something else.
        raise EvalkitError(f"{path}: not a head file nor the ICT-FaceKit subset ({type(error).__name__})") from error
    return IctFace(neutral, triangles, np.asarray(listed), parts, expressions, identities)


def _folder(path: Path) -> IctFace:
    """The folder with generic_neutral_mesh.obj, expressions, identities and indices."""
    neutral = next(iter(sorted(path.rglob("generic_neutral_mesh.obj"))), None)
    indices = next(iter(sorted(path.rglob("vertex_indices.json"))), None)
    if neutral is None or indices is None:
        raise EvalkitError(f"{path}: no ICT-FaceKit: generic_neutral_mesh.obj and vertex_indices.json are needed")
    vertices, triangles = read_mesh(neutral)
    expressions: dict[str, Array] = {}
    identities: dict[str, Array] = {}
    for file in sorted(neutral.parent.glob("*.obj")):
        if file == neutral:
            continue
        shape, _ = read_mesh(file)
        if len(shape) != len(vertices):
            raise EvalkitError(f"{file}: {len(shape)} vertices, the neutral face has {len(vertices)}")
        (identities if file.stem.startswith("identity") else expressions)[file.stem] = UNIT_MM * shape
    listed = np.asarray(read_indices(indices)["idx_to_landmark_verts"])
    return IctFace(UNIT_MM * vertices, triangles, listed, PARTS, expressions, identities)


def read_indices(path: Path) -> dict[str, Any]:
    """ICT-FaceKit's JSON of vertex numbers.

    Raises
    ------
    EvalkitError
        If it lists no landmarks.
    """
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        facts["idx_to_landmark_verts"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EvalkitError(f"{path}: lists no idx_to_landmark_verts") from error
    return dict(facts)


def read_ict(path: Path) -> Head:
    """The whole head of ICT-FaceKit, expressions and identities as blendshapes; see :func:`ict_face`."""
    face = ict_face(path)
    ends = {"skin": ("face", "head_and_neck"), "mouth pocket": ("mouth_socket",),
            "lids": ("eye_socket_left", "eye_socket_right"), "tongue": ("gums_and_tongue",), "teeth": ("teeth",),
            "eyeballs": ("eyeball_left", "eyeball_right")}  # fmt: skip
    highest = face.triangles.max(axis=1)
    pieces, parts, start = [], {}, 0
    for part, names in ends.items():
        # A triangle across two ranges belongs to the later one.
        ranges = [face.parts[name] for name in names]
        chosen = np.any([(highest >= first) & (highest < last) for first, last in ranges], axis=0)
        pieces.append(face.triangles[chosen])
        parts[part] = (start, start + int(chosen.sum()))
        start += int(chosen.sum())
    count = max(end for _, end in face.parts.values())
    vertices = face.vertices[:count]
    landmarks = {name: vertices[face.landmarks[number - 1]] for name, number in LANDMARKS.items()}
    return head_by_landmarks(
        "ICT-FaceKit", vertices, np.concatenate(pieces), landmarks, parts=parts, source=SOURCE,
        blendshapes=blendshapes({**face.expressions, **face.identities}, vertices),
    )  # fmt: skip


def blendshapes(shapes: dict[str, Array], rest: Array) -> dict[str, tuple[Indices, Array]]:
    """Moved vertices and their displacements of each shape, of the first vertices that ``rest`` (V, 3), mm, has."""
    found: dict[str, Any] = {}
    for name, shape in shapes.items():
        moves = shape[: len(rest)] - rest
        which = np.flatnonzero(np.abs(moves).max(axis=1) > MOVES_MM)
        found[name] = (which, moves[which])
    return found
