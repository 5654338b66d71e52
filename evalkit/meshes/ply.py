"""PLY (Stanford polygon format), text and binary."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.meshes.model import Indices, Mesh, vertex_normals

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")
NORMALS = ("nx", "ny", "nz")


@dataclass
class _Element:
    """``properties``: name, NumPy type, type of the count of a list or None."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        return any(count is not None for _, _, count in self.properties)


def read_ply(path: Path, content: bytes) -> Mesh:
    """A mesh of the file's content.

    Raises
    ------
    EvalkitError
        If the header or the data cannot be read.
    """
    try:
        order, elements, start = _header(content)
        return _mesh(path, content, order, elements, start)
    except EvalkitError as error:
        raise EvalkitError(f"{path}: {error}") from None
    except (ValueError, IndexError, KeyError, struct.error, OverflowError, MemoryError) as error:
        raise EvalkitError(f"{path}: cannot be read as a PLY file ({error}); export it again") from error


def _header(content: bytes) -> tuple[str, list[_Element], int]:
    head, found, _ = content.partition(b"end_header")
    start = content.find(b"\n", len(head)) + 1
    lines = [line.split() for line in head.decode("latin-1").splitlines()]
    if not found or not start or lines[:1] != [["ply"]]:
        raise EvalkitError("is no PLY file: it does not begin with a header")
    elements: list[_Element] = []
    order = None
    for words in lines:
        match words:
            case ["format", name, _]:
                order = ORDERS[name]
            case ["element", name, count]:
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, kind, name]:
                elements[-1].properties.append((name, TYPES[kind], TYPES[count]))
            case ["property", kind, name]:
                elements[-1].properties.append((name, TYPES[kind], None))
    if order is None:
        raise EvalkitError("the header names no format")
    if any(element.count < 0 for element in elements):
        raise EvalkitError("the header has a negative count")
    return order, elements, start


def _mesh(path: Path, content: bytes, order: str, elements: list[_Element], start: int) -> Mesh:
    lines = content[start:].splitlines(keepends=True) if not order else []
    place, vertices, faces, vertex_at = (0 if not order else start), None, None, 0
    for element in elements:
        if element.name == "vertex":
            if element.has_lists or not {"x", "y", "z"} <= {name for name, _, _ in element.properties}:
                raise EvalkitError("its vertices have no x, y and z, or lists among them")
            vertex_at = place
        if not order:
            rows = [line.split() for line in lines[place : place + element.count]]
            if len(rows) < element.count:
                raise EvalkitError(f"ends within the {element.name} list; export it again")
            place += element.count
            if element.name == "vertex":
                vertices = _columns(element, rows)
            elif element.name == "face":
                faces = _text_faces(element, rows)
        elif element.has_lists:
            found, place = _binary_faces(element, content, place, order)
            faces = found if element.name == "face" else faces
        else:
            kind = np.dtype([(name, order + t) for name, t, _ in element.properties])
            end = place + element.count * kind.itemsize
            if end > len(content):
                raise EvalkitError(f"ends within the {element.name} list; export it again")
            if element.name == "vertex":
                vertices = np.frombuffer(content[place:end], dtype=kind)
            place = end
    if vertices is None or faces is None:
        raise EvalkitError("holds no vertices or no faces; export the mesh with its faces")
    table, triangulated = vertices, Mesh(path, _places(vertices), *faces, lambda *_: b"")

    def rewritten(places: Array, targets: Mapping[str, Array]) -> bytes:
        out = table.copy()
        values = dict(zip("xyz", places.T, strict=True))
        if set(NORMALS) <= set(table.dtype.names or ()):
            values |= dict(zip(NORMALS, vertex_normals(places, triangulated.triangles()).T, strict=True))
        for name, column in values.items():
            out[name] = column
        if order:
            return content[:vertex_at] + out.tobytes() + content[vertex_at + out.nbytes :]
        # Numbers of each column's type, as short as they can be and read back the same.
        kinds = [out.dtype[name].type for name in out.dtype.names or ()]
        texts = [" ".join(str(kind(x)) for kind, x in zip(kinds, row, strict=True)) for row in out.tolist()]
        body = [
            text.encode() + line[len(line.rstrip()) :]
            for text, line in zip(texts, lines[vertex_at : vertex_at + len(out)], strict=True)
        ]
        return content[:start] + b"".join([*lines[:vertex_at], *body, *lines[vertex_at + len(out) :]])

    return Mesh(path, _places(vertices), *faces, rewritten)


def _places(table: np.ndarray) -> Array:
    return np.stack([table[name] for name in "xyz"], axis=1).astype(np.float64)


def _columns(element: _Element, rows: list[list[bytes]]) -> np.ndarray:
    """A table of the vertices of a text file."""
    names = [name for name, _, _ in element.properties]
    # In double precision whatever the header says: what is written as text need not be rounded.
    kinds = ["f8" if t == "f4" and name in (*"xyz", *NORMALS) else t for name, t, _ in element.properties]
    out = np.empty(len(rows), dtype=list(zip(names, kinds, strict=True)))
    columns = list(zip(*rows, strict=True))
    if any(len(row) != len(names) for row in rows):
        bad = next(k for k, row in enumerate(rows) if len(row) != len(names))
        raise EvalkitError(f"vertex {bad} has {len(rows[bad])} numbers; the header names {len(names)}")
    for name, column in zip(names, columns, strict=True):
        out[name] = np.array(column).astype(np.float64)
    return out


def _text_faces(element: _Element, rows: list[list[bytes]]) -> tuple[Indices, Indices]:
    sizes, corners = [], []
    for row in rows:
        at = 0
        for name, _, count in element.properties:
            size = 1 if count is None else int(row[at])
            at += count is not None
            if name in CORNERS:
                sizes.append(size)
                corners += [int(word) for word in row[at : at + size]]
            at += size
        if at > len(row):
            raise EvalkitError(f"face {len(sizes) - 1} ends early")
    return np.array(sizes, dtype=np.intp), np.array(corners, dtype=np.intp)


def _binary_faces(element: _Element, content: bytes, place: int, order: str) -> tuple[tuple[Indices, Indices], int]:
    """Corners of the faces, and where the element ends."""
    alike = _alike_faces(element, content, place, order)
    if alike is not None:
        return alike
    sizes: list[int] = []
    corners: list[tuple[int, ...]] = []
    for _ in range(element.count):
        for name, kind, count in element.properties:
            size = 1
            if count is not None:
                (size,) = struct.unpack_from(order + np.dtype(count).char, content, place)
                place += np.dtype(count).itemsize
            if name in CORNERS:
                sizes.append(size)
                corners.append(struct.unpack_from(f"{order}{size}{np.dtype(kind).char}", content, place))
            place += size * np.dtype(kind).itemsize
    flat = [v for face in corners for v in face]
    return (np.array(sizes, dtype=np.intp), np.array(flat, dtype=np.intp)), place


def _alike_faces(
    element: _Element, content: bytes, place: int, order: str
) -> tuple[tuple[Indices, Indices], int] | None:
    """The same at once, where all faces have as many corners as the first and nothing else is a list."""
    lists = [(name, count) for name, _, count in element.properties if count is not None]
    if len(lists) != 1 or lists[0][0] not in CORNERS or not element.count:
        return None
    kinds: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    before = 0
    for name, kind, count in element.properties:
        if count is None:
            kinds.append((name, order + kind))
            before += 0 if any(k[0] == "count of corners" for k in kinds) else np.dtype(kind).itemsize
        else:
            (size,) = struct.unpack_from(order + np.dtype(count).char, content, place + before)
            kinds += [("count of corners", order + count), (name, order + kind, (size,))]
    record = np.dtype(kinds)
    end = place + element.count * record.itemsize
    if end > len(content):
        return None
    table = np.frombuffer(content[place:end], dtype=record)
    if not (table["count of corners"] == size).all():
        return None
    return (np.full(element.count, size, dtype=np.intp), table[lists[0][0]].astype(np.intp).ravel()), end
