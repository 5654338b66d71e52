"""Wavefront OBJ."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.meshes.model import Mesh

CONTINUED = re.compile(rb"\\\r?\n")
NORMAL = re.compile(rb"(/-?\d*)/-?\d*")
"""Of a corner ``vertex/texture/normal`` the last two, with their slashes."""


def read_obj(path: Path, content: bytes) -> Mesh:
    """A mesh of the file's content.

    Raises
    ------
    EvalkitError
        If a vertex or face cannot be read; with its line.
    """
    lines, vertex_lines, face_lines = _lines(content)
    if not vertex_lines:
        raise EvalkitError(f"{path}: holds no vertices; is it an OBJ file?")
    try:
        rows = [lines[k].split()[1:4] for k in vertex_lines]
        vertices = np.array(rows, dtype=np.float64)
    except ValueError:
        vertices = np.zeros(0)
    if vertices.shape != (len(vertex_lines), 3):
        bad = next(k for k in vertex_lines if not _three_numbers(lines[k]))
        raise EvalkitError(f"{path}: line {bad + 1} is no vertex: {_shown(lines[bad])}")
    sizes, corners, before = [], [], np.searchsorted(vertex_lines, face_lines)
    for k, known in zip(face_lines, before, strict=True):
        try:
            face = [int(corner.partition(b"/")[0]) for corner in lines[k].partition(b"#")[0].split()[1:]]
        except ValueError:
            raise EvalkitError(f"{path}: line {k + 1} is no face: {_shown(lines[k])}") from None
        if 0 in face:
            raise EvalkitError(f"{path}: line {k + 1} names vertex 0; vertices of OBJ count from 1")
        sizes.append(len(face))
        # Negative numbers count back from the vertices read so far.
        corners += [v - 1 if v > 0 else int(known) + v for v in face]

    def rewritten(places: Array, targets: Mapping[str, Array]) -> bytes:
        # Split again: the lines of many shapes, kept, would fill the memory.
        out, vertex_lines, face_lines = _lines(content)
        for k, place in zip(vertex_lines, places.tolist(), strict=True):
            body, more = out[k].rstrip(), out[k].split()[4:]
            text = [b"v", *(repr(x).encode() for x in place), *more]
            out[k] = b" ".join(text) + out[k][len(body) :]
        for k in face_lines:
            out[k] = NORMAL.sub(lambda found: found[1] if len(found[1]) > 1 else b"", out[k])
        # Normals of the shape that was read are not those of this one; programs make their own where none are stored.
        return b"".join(line for line in out if line.lstrip()[:2] != b"vn")

    return Mesh(path, vertices, np.array(sizes, dtype=np.intp), np.array(corners, dtype=np.intp), rewritten)


def _lines(content: bytes) -> tuple[list[bytes], list[int], list[int]]:
    """Lines of a file, and which of them are vertices and faces.

    As bytes throughout: comments and names may be in any encoding, and come back as they were.
    """
    lines = CONTINUED.sub(b" ", content).splitlines(keepends=True)
    # The first two letters tell them apart, blanks before them aside; splitting every line takes several times as long.
    heads = [line.lstrip()[:2].rstrip() for line in lines]
    vertex_lines, face_lines = ([k for k, head in enumerate(heads) if head == kind] for kind in (b"v", b"f"))
    return lines, vertex_lines, face_lines


def _three_numbers(line: bytes) -> bool:
    try:
        return len([float(word) for word in line.split()[1:4]]) == 3
    except ValueError:
        return False


def _shown(line: bytes) -> str:
    return repr(line.decode("latin-1").strip()[:60])
