"""Mesh files of other programs, read and written back with every vertex in its place.

Libraries that read such files split vertices at texture seams, join equal ones or triangulate; shapes of one character
must keep the order they came in. What is written is the file that was read, with other positions in it.
"""

from __future__ import annotations

from pathlib import Path

from evalkit.errors import EvalkitError
from evalkit.meshes.gltf import read_gltf
from evalkit.meshes.model import Mesh
from evalkit.meshes.obj import read_obj
from evalkit.meshes.ply import read_ply

formats = {".obj": read_obj, ".ply": read_ply, ".glb": read_gltf, ".gltf": read_gltf}
"""Ending -> function of the file's path and content."""


def read_mesh_file(path: str | Path) -> Mesh:
    """A mesh file: OBJ, PLY (text or binary) or glTF 2.0 (``.glb``, ``.gltf``).

    Raises
    ------
    EvalkitError
        If the file cannot be read, holds no face, or a position is not finite; with the number of line or vertex.
    """
    path = Path(path)
    read = formats.get(path.suffix.lower())
    if read is None:
        raise EvalkitError(f"{path}: '{path.suffix}' is no mesh file; known are {', '.join(formats)}")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not content.strip():
        raise EvalkitError(f"{path}: the file is empty; export the mesh again")
    return read(path, content).checked()
