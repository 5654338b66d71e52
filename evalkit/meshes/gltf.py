"""glTF 2.0 (Khronos Group, ISO/IEC 12113:2022): ``.glb``, and ``.gltf`` with its buffers beside it or within."""

from __future__ import annotations

import base64
import copy
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.meshes.model import Indices, Mesh, vertex_normals

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
FLOAT, VERTEX_DATA, TRIANGLES = 5126, 34962, 4
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
SHAPE = ("POSITION", "NORMAL", "TANGENT")
PLACED = ("matrix", "translation", "rotation", "scale")


def container(document: bytes, data: bytes) -> bytes:
    """The binary container (``.glb``) of a JSON document and its buffer."""
    document += b" " * (-len(document) % 4)
    data += b"\0" * (-len(data) % 4)
    length = 12 + 8 + len(document) + 8 + len(data)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, length),
            struct.pack("<I4s", len(document), b"JSON"),
            document,
            struct.pack("<I4s", len(data), b"BIN\0"),
            data,
        ]
    )


def read_gltf(path: Path, content: bytes) -> Mesh:
    """A mesh of the file's content: all its meshes, one after the other, each vertex once.

    Vertices are in the order of the accessors that the meshes name first; a morph target is one wherever its name
    occurs.

    Raises
    ------
    EvalkitError
        If the content is no glTF 2.0, is compressed, or holds something that shapes cannot be made of.
    """
    try:
        return _Document(path, content).mesh()
    except EvalkitError as error:
        raise EvalkitError(f"{path}: {error}") from None
    except OSError as error:
        raise EvalkitError(f"{path}: needs {error.filename}, which cannot be read ({error.strerror})") from error
    except (ValueError, IndexError, KeyError, TypeError, AttributeError, struct.error, MemoryError) as error:
        reason = f"{type(error).__name__} {error}".strip()
        raise EvalkitError(f"{path}: cannot be read as glTF 2.0 ({reason}); export it again") from error


class _Document:
    """The JSON document and its buffers, joined into one."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path, self.binary = path, content[:4] == b"glTF"
        document, inside = _chunks(content) if self.binary else (content, b"")
        try:
            self.json: dict[str, Any] = json.loads(document)
        except ValueError:
            raise EvalkitError("is no glTF file") from None
        if not str(self.json["asset"]["version"]).startswith("2."):
            raise EvalkitError(f"is glTF {self.json['asset']['version']}; export it as glTF 2.0")
        for name in COMPRESSED:
            if name in self.json.get("extensionsRequired", []):
                raise EvalkitError(f"is compressed ({name}); export it without compression")
        self.data = bytearray()
        starts = []
        for buffer in self.json.get("buffers", []):
            self.data += b"\0" * (-len(self.data) % 4)
            starts.append(len(self.data))
            self.data += inside if "uri" not in buffer else self._loaded(buffer["uri"])
            if len(self.data) - starts[-1] < buffer["byteLength"]:
                raise EvalkitError("its buffer is shorter than it says; the file is cut off")
        for view in self.json.get("bufferViews", []):
            view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
            view["buffer"] = 0

    def _loaded(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return (self.path.parent / unquote(uri)).read_bytes()

    def mesh(self) -> Mesh:
        meshes, joined = self.json.get("meshes", []), {}
        self._check_places()
        blocks: list[Array] = []
        corners: list[Indices] = []
        count = 0
        for primitive in (p for m in meshes for p in m["primitives"]):
            mode = primitive.get("mode", TRIANGLES)
            if mode > TRIANGLES:
                raise EvalkitError("holds strips or fans of triangles; export it with plain triangles")
            if mode < TRIANGLES:  # points and lines
                continue
            position = primitive["attributes"]["POSITION"]
            if position not in joined:
                joined[position] = slice(count, count + self.json["accessors"][position]["count"])
                blocks.append(self.array(position))
                count = joined[position].stop
            own = (
                self.array(primitive["indices"]).ravel().astype(np.intp)
                if "indices" in primitive
                else np.arange(len(self.array(position)))
            )
            if len(own) % 3:
                raise EvalkitError("a list of triangles ends within one; the file is damaged")
            corners.append(own + joined[position].start)
        if not blocks:
            raise EvalkitError("holds no triangles; export the mesh with its faces")
        vertices, flat = np.concatenate(blocks), np.concatenate(corners)
        targets: dict[str, Array] = {}
        for mesh in meshes:
            for name, primitive, k in _targets(mesh):
                if "POSITION" in (target := primitive["targets"][k]):
                    where = joined[primitive["attributes"]["POSITION"]]
                    place = targets.setdefault(name, vertices.copy())
                    place[where] = vertices[where] + self.array(target["POSITION"])
                else:
                    targets.setdefault(name, vertices.copy())

        def rewritten(places: Array, new: Mapping[str, Array]) -> bytes:
            return self.replaced(joined, vertices, flat.reshape(-1, 3), places, new)

        sizes = np.full(len(flat) // 3, 3, dtype=np.intp)
        return Mesh(self.path, vertices, sizes, flat, rewritten, targets)

    def _check_places(self) -> None:
        """Refuse meshes that the scene moves apart: their vertices are in axes of their own."""
        placed = {
            json.dumps({key: node.get(key) for key in PLACED}) for node in self.json.get("nodes", []) if "mesh" in node
        }
        if len(placed) > 1:
            raise EvalkitError(
                "holds several meshes that are moved, turned or scaled apart; apply their transforms before exporting"
            )

    def array(self, index: int) -> Array:
        """Numbers of an accessor, (count, width)."""
        accessor = self.json["accessors"][index]
        count, width = accessor["count"], WIDTHS[accessor["type"]]
        kind = np.dtype(COMPONENTS[accessor["componentType"]]).newbyteorder("<")
        out = np.zeros((count, width))
        if "bufferView" in accessor:
            out[:] = self._view(accessor["bufferView"], accessor.get("byteOffset", 0), count, width, kind)
        if sparse := accessor.get("sparse"):
            few, at, values = sparse["count"], sparse["indices"], sparse["values"]
            which = np.dtype(COMPONENTS[at["componentType"]]).newbyteorder("<")
            rows = self._view(at["bufferView"], at.get("byteOffset", 0), few, 1, which).ravel()
            out[rows] = self._view(values["bufferView"], values.get("byteOffset", 0), few, width, kind)
        if accessor.get("normalized"):
            out = np.maximum(out / np.iinfo(kind).max, -1.0)
        return out

    def _view(self, index: int, offset: int, count: int, width: int, kind: np.dtype[Any]) -> NDArray[Any]:
        view = self.json["bufferViews"][index]
        step = view.get("byteStride", width * kind.itemsize)
        start = view["byteOffset"] + offset
        if offset + (count - 1) * step + width * kind.itemsize > view["byteLength"]:
            raise EvalkitError(f"accessor data ends beyond buffer view {index}; the file is damaged")
        return np.ndarray((count, width), kind, self.data, start, (step, kind.itemsize))

    def replaced(
        self, joined: dict[int, slice], before: Array, triangles: Indices, places: Array, targets: Mapping[str, Array]
    ) -> bytes:
        """The file with other positions.

        Data that nothing names any more stays in the buffer: what else may refer to it, extensions know.
        """
        new = copy.copy(self)
        new.json, new.data = copy.deepcopy(self.json), bytearray(self.data)
        moved = not np.array_equal(places, before)
        rest, made = vertex_normals(places, triangles), {}
        bent = {name: vertex_normals(target, triangles) - rest for name, target in targets.items()}

        def stored(key: object, values: Array) -> int:
            if key not in made:
                made[key] = new.added(values)
            return made[key]

        for mesh in new.json["meshes"]:
            for primitive in mesh["primitives"]:
                attributes = primitive["attributes"]
                if primitive.get("mode", TRIANGLES) != TRIANGLES:
                    continue
                at = attributes["POSITION"]
                for name, k in ((name, k) for name, p, k in _targets(mesh) if p is primitive and name in targets):
                    target = {"POSITION": stored(("POSITION", name, at), (targets[name] - places)[joined[at]])}
                    if "NORMAL" in attributes:
                        target["NORMAL"] = stored(("NORMAL", name, at), bent[name][joined[at]])
                    others = {key: v for key, v in primitive["targets"][k].items() if key not in SHAPE}
                    primitive["targets"][k] = {**others, **target}
                if moved:
                    attributes["POSITION"] = stored(("POSITION", at), places[joined[at]])
                    attributes.pop("TANGENT", None)
                    if "NORMAL" in attributes:
                        attributes["NORMAL"] = stored(("NORMAL", at), rest[joined[at]])
        return new.content()

    def added(self, values: Array) -> int:
        """Number of a new accessor."""
        stored = np.ascontiguousarray(values, dtype="<f4")
        self.data += b"\0" * (-len(self.data) % 4)
        views, accessors = self.json["bufferViews"], self.json["accessors"]
        views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": stored.nbytes, "target": VERTEX_DATA})
        self.data += stored.tobytes()
        low, high = stored.min(axis=0).tolist(), stored.max(axis=0).tolist()
        about = {"componentType": FLOAT, "count": len(stored), "type": "VEC3", "min": low, "max": high}
        accessors.append({"bufferView": len(views) - 1, **about})
        return len(accessors) - 1

    def content(self) -> bytes:
        for image in self.json.get("images", []):
            # A picture beside the file that was read is not beside the one that is written.
            if not image.get("uri", "data:").startswith("data:"):
                picture = self.path.parent / unquote(image["uri"])
                if picture.is_file():
                    kind = "image/jpeg" if picture.suffix.lower() in (".jpg", ".jpeg") else "image/png"
                    image["uri"] = f"data:{kind};base64," + base64.b64encode(picture.read_bytes()).decode()
        buffer: dict[str, Any] = {"byteLength": len(self.data)}
        self.json["buffers"] = [buffer]
        if not self.binary:
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        document = json.dumps(self.json, separators=(",", ":")).encode()
        return container(document, bytes(self.data)) if self.binary else document


def _chunks(content: bytes) -> tuple[bytes, bytes]:
    """The JSON and the binary chunk of a container."""
    _, version, length = struct.unpack_from("<4sII", content)
    if version != 2:
        raise EvalkitError(f"is glTF {version}; export it as glTF 2.0")
    if length > len(content):
        raise EvalkitError("is shorter than it says; the file is cut off")
    found: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<I4s", content, place)
        found.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size
    return found[b"JSON"], found.get(b"BIN\0", b"")


def _targets(mesh: dict[str, Any]) -> list[tuple[str, dict[str, Any], int]]:
    """Name, primitive and number of every morph target of a mesh."""
    names = mesh.get("extras", {}).get("targetNames", []) if isinstance(mesh.get("extras", {}), dict) else []
    return [
        (str(names[k]) if k < len(names) else f"target {k}", primitive, k)
        for primitive in mesh["primitives"]
        if primitive.get("mode", TRIANGLES) == TRIANGLES
        for k in range(len(primitive.get("targets", [])))
    ]
