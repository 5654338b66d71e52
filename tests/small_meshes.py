"""Small meshes in the files of other programs, written here byte by byte so that they check the readers."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np


def dome(n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A bulging sheet of n x n vertices with a nose, and its quads."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, n), np.linspace(-1.2, 1.2, n))
    z = 0.8 - 0.4 * x**2 - 0.3 * y**2 + 0.3 * np.exp(-(((x - 0.05) / 0.25) ** 2 + (y / 0.3) ** 2))
    k = np.arange(n * n).reshape(n, n)
    quads = np.stack([k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]], axis=-1).reshape(-1, 4)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), quads


def push(v: np.ndarray, at: tuple[float, float], by: tuple[float, float, float], width: float = 0.5) -> np.ndarray:
    """Displacements of a bump."""
    weight = np.exp(-((v[:, :2] - at) ** 2).sum(axis=1) / width**2)
    return weight[:, None] * np.array(by)


def expressions(v: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Rough shapes of four expressions, and what a sculptor makes of them: not linear in the rough ones."""
    rough = {
        "smile": v + push(v, (0.5, -0.6), (0.2, 0.15, 0.1)),
        "frown": v + push(v, (-0.4, 0.7), (-0.1, 0.2, 0.1)),
        "grin": v + push(v, (0.5, -0.6), (0.12, 0.1, 0.06)) + push(v, (-0.5, -0.6), (-0.05, 0.1, 0.0)),
        "wink": v + push(v, (0.4, 0.6), (0.0, -0.2, 0.1), 0.35),
    }
    fine = {name: shape + 1.5 * (shape - v) * (1.0 + (shape - v)[:, :1]) for name, shape in rough.items()}
    return rough, fine


def write_obj(path: Path, v: np.ndarray, faces: np.ndarray, end: str = "\r\n", digits: int = 6) -> None:
    """As Blender does it: comments, texture coordinates and a normal per face; lines of the ending given."""
    lines = ["# Blender 4.2 \u00e4", "mtllib x.mtl", "o Head"]
    lines += ["v " + " ".join(f"{x:.{digits}f}" for x in row) for row in v]
    lines += [f"vn 0.0 0.0 {1 + k % 7}" for k in range(len(faces))]
    lines += [f"vt {k / (4 * len(faces)):.6f} 0.5" for k in range(4 * len(faces))]
    lines += ["s 1", "usemtl Skin"]
    lines += [
        "f " + " ".join(f"{c + 1}/{4 * k + n + 1}/{k + 1}" for n, c in enumerate(face)) for k, face in enumerate(faces)
    ]
    path.write_bytes(end.join([*lines, ""]).encode("latin-1"))


def write_ply(path: Path, v: np.ndarray, faces: list[list[int]], form: str) -> None:
    """Vertices of float and a colour, normals, an element in between and faces with a quality."""
    head = [
        "ply", f"format {form} 1.0", "comment by hand", f"element vertex {len(v)}", "property float x",
        "property float y", "property float z", "property float nx", "property float ny", "property float nz",
        "property uchar red", "property uchar green",
        "property uchar blue", "element mood 2", "property short a", f"element face {len(faces)}",
        "property float quality", "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    order = ">" if "big" in form else "<"
    rows = [(*row, 0.0, 0.0, 1.0, k % 256, 7, 9) for k, row in enumerate(v.tolist())]
    if form == "ascii":
        body = "".join(" ".join(repr(x) for x in row) + "\n" for row in rows) + "1\n2\n"
        body += "".join(f"0.5 {len(f)} {' '.join(map(str, f))}\n" for f in faces)
        data = body.encode()
    else:
        data = b"".join(struct.pack(order + "6f3B", *row) for row in rows) + struct.pack(order + "2h", 1, 2)
        data += b"".join(struct.pack(f"{order}fB{len(f)}i", 0.5, len(f), *f) for f in faces)
    path.write_bytes(("\n".join(head) + "\n").encode() + data)


def write_glb(
    path: Path, v: np.ndarray, triangles: np.ndarray, targets: dict[str, np.ndarray], *, sparse: bool = False
) -> None:
    """Two primitives that share their vertices, normals between positions, and targets, the first of them sparse.

    The ending decides between one binary file and JSON with its buffer beside it.
    """
    data, views, accessors = bytearray(), [], []

    def view(content: bytes, **more: int) -> int:
        data.extend(b"\0" * (-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(content), **more})
        data.extend(content)
        return len(views) - 1

    def accessor(**facts: object) -> int:
        accessors.append(facts)
        return len(accessors) - 1

    count = len(v)
    both = view(
        np.concatenate([v, np.tile([0.0, 0.0, 1.0], (count, 1))], axis=1).astype("<f4").tobytes(), byteStride=24
    )
    about = {"componentType": 5126, "count": count, "type": "VEC3"}
    box = {"min": v.min(axis=0).tolist(), "max": v.max(axis=0).tolist()}
    position, normal = accessor(bufferView=both, **about, **box), accessor(bufferView=both, byteOffset=12, **about)
    morphs = []
    for name, shape in targets.items():
        move = (shape - v).astype("<f4")
        if sparse and name == next(iter(targets)):
            which = np.flatnonzero(np.abs(move).max(axis=1) > 0.0).astype("<u2")
            parts = {"indices": {"bufferView": view(which.tobytes()), "componentType": 5123}}
            parts["values"] = {"bufferView": view(move[which].tobytes())}
            morphs.append({"POSITION": accessor(**about, sparse={"count": len(which), **parts})})
        else:
            morphs.append({"POSITION": accessor(bufferView=view(move.tobytes()), **about)})
    primitives = []
    for part in (triangles[: len(triangles) // 2], triangles[len(triangles) // 2 :]):
        indices = accessor(
            bufferView=view(part.astype("<u2").tobytes()), componentType=5123, count=part.size, type="SCALAR"
        )
        one = {"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices}
        primitives.append({**one, "targets": morphs} if morphs else one)
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives, "extras": {"targetNames": list(targets)}}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data)}],
    }  # fmt: skip
    if path.suffix == ".gltf":
        document["buffers"][0]["uri"] = "the%20data.bin"
        path.with_name("the data.bin").write_bytes(bytes(data))
        path.write_text(json.dumps(document))
        return
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    data.extend(b"\0" * (-len(data) % 4))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + bytes(data)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
