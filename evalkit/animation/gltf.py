"""The moving head as glTF 2.0: one mesh with morph targets, their weights over time, and the head's motion.

The format is that of the Khronos Group's glTF 2.0 specification (ISO/IEC 12113:2022), in its binary container
(``.glb``). Lengths are metres there; axes are the head's, x to its left, y up, z forward.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit import __version__
from evalkit.animation.performance import Animation
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, blocks, quaternion_from_rotation
from evalkit.head import Head
from evalkit.meshes.gltf import container
from evalkit.meshes.model import vertex_normals

TOLERANCE_MM = 0.5
"""Targets are added until no vertex is further than this from the animation in any frame: a pixel in a portrait of
500 pixels. Every marker moves by itself, if only by its noise, so half the tolerance takes nearly twice the targets."""

MOST_TARGETS = 96
"""Beyond this many a mesh is no longer fit for a browser: every target is another copy of it."""

BASIS_FRAMES = 300
"""Frames, spread evenly and joined by those of the extremes, from which the targets are computed."""

SEE_THROUGH = {"upper teeth": "MASK", "lower teeth": "MASK", "plate": "BLEND"}
"""Parts whose texture is transparent in places, and how it is drawn there."""

PLAIN = (0.78, 0.56, 0.44, 1.0)
"""Colour of a head without a texture, linear."""

FLOAT, UINT = 5126, 5125
VERTEX_DATA, INDEX_DATA = 34962, 34963
MM = 0.001


def write_glb(animation: Animation, path: str | Path, tolerance_mm: float = TOLERANCE_MM) -> dict[str, Any]:
    """Write an animation as a binary glTF file, complete or not at all.

    Parameters
    ----------
    animation : Animation
    path : str or Path
        ``.glb``.
    tolerance_mm : float
        As :data:`TOLERANCE_MM`.

    Returns
    -------
    dict
        ``targets``, ``largest_error_mm`` and ``rms_error_mm`` of the vertices over all frames, ``bytes``.

    Raises
    ------
    EvalkitError
        If the file cannot be written.
    """
    path = Path(path)
    targets, weights, errors = morph_targets(animation, tolerance_mm)
    content = _content(animation, targets, weights)
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except OSError as error:
        raise EvalkitError(f"{path}: cannot write the mesh ({error.strerror or error})") from error
    finally:
        temporary.unlink(missing_ok=True)
    return {"targets": len(targets), **errors, "bytes": len(content)}


def morph_targets(animation: Animation, tolerance_mm: float) -> tuple[Array, Array, dict[str, float]]:
    """Principal components of the vertices' motion, as many as the tolerance asks for.

    Parameters
    ----------
    animation : Animation
    tolerance_mm : float

    Returns
    -------
    targets : ndarray, shape (K, V, 3), mm
        Displacements from rest, each as large as in the frame that uses it most.
    weights : ndarray, shape (F, K)
        Within -1 to 1, the range that other programs give to a slider.
    errors : dict of str to float
        ``largest_error_mm`` and ``rms_error_mm`` over all vertices and frames.
    """
    head = animation.head
    some = _telling_frames(animation)
    motion = (animation.vertices(some) - head.vertices).reshape(len(some), -1)
    # Eigenvectors of the frames' products: frames are few and coordinates many. In double precision, or the weak
    # components would be rounding; block by block, since a second copy of all is not needed for it.
    products = np.zeros((len(some), len(some)))
    for columns in blocks(motion.shape[1], 30_000):
        part = motion[:, columns].astype(np.float64)
        products += part @ part.T
    strength, mixture = np.linalg.eigh(products)
    kept = np.flatnonzero(strength > 1e-10 * max(strength[-1], 1e-12))[::-1][:MOST_TARGETS]
    basis = (mixture[:, kept] / np.sqrt(strength[kept])).T @ motion
    weights = np.empty((animation.frames, len(basis)))
    for start, shown in animation.batches():
        weights[start : start + len(shown)] = (shown - head.vertices).reshape(len(shown), -1) @ basis.T
    count, errors = 0, _errors(animation, basis[:0], weights[:, :0])
    while errors["largest_error_mm"] > tolerance_mm and count < len(basis):
        # In steps: every look at the error goes over all frames.
        count = min(count + max(4, count // 8), len(basis))
        errors = _errors(animation, basis[:count], weights[:, :count])
    size = np.maximum(np.abs(weights[:, :count]).max(axis=0, initial=0.0), 1e-12)
    return (basis[:count] * size[:, None]).reshape(count, len(head.vertices), 3), weights[:, :count] / size, errors


def _telling_frames(animation: Animation) -> list[int]:
    """Frames spread over the animation, and those in which something goes furthest."""
    spread = np.linspace(0, animation.frames - 1, min(animation.frames, BASIS_FRAMES)).astype(int)
    tracks = [animation.displacements.reshape(animation.frames, -1), animation.lids_closed, animation.jaw_deg[:, None]]
    track = np.concatenate(tracks, axis=1)
    # Where a blink begins and ends the lids are half-way on their arc, which no mean of open and closed gives.
    moving = np.flatnonzero((animation.lids_closed.max(axis=1) > 0.02) & (animation.lids_closed.max(axis=1) < 0.98))
    half_way = moving[:: max(len(moving) // 60, 1)]
    return list(np.unique(np.concatenate([spread, track.argmin(axis=0), track.argmax(axis=0), half_way])))


def _errors(animation: Animation, basis: Array, weights: Array) -> dict[str, float]:
    largest, total = 0.0, 0.0
    for start, part in animation.batches():
        rebuilt = (weights[start : start + len(part)] @ basis).reshape(len(part), -1, 3)
        square = np.sum((part - animation.head.vertices - rebuilt) ** 2, axis=2)
        largest, total = max(largest, float(square.max(initial=0.0))), total + float(square.sum())
    count = animation.frames * len(animation.head.vertices)
    return {"largest_error_mm": float(np.sqrt(largest)), "rms_error_mm": float(np.sqrt(total / count))}


class _Buffer:
    """The binary part of the file: arrays one after the other, and what the JSON part says of them."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, content: bytes, target: int | None = None) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += content
        return len(self.views) - 1

    def array(self, values: NDArray[Any], target: int | None = None, *, bounds: bool = False) -> int:
        whole = values.dtype.kind in "iu"
        stored = np.ascontiguousarray(values, dtype="<u4" if whole else "<f4")
        accessor: dict[str, Any] = {
            "bufferView": self.view(stored.tobytes(), target),
            "componentType": UINT if whole else FLOAT,
            "count": len(stored),
            "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[1 if stored.ndim == 1 else stored.shape[1]],
        }
        if bounds:
            accessor["min"] = np.atleast_1d(stored.min(axis=0)).tolist()
            accessor["max"] = np.atleast_1d(stored.max(axis=0)).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _content(animation: Animation, targets: Array, weights: Array) -> bytes:
    head, buffer = animation.head, _Buffer()
    normals = vertex_normals(head.vertices, head.triangles)
    attributes = {
        "POSITION": buffer.array(head.vertices * MM, VERTEX_DATA, bounds=True),
        "NORMAL": buffer.array(normals, VERTEX_DATA),
    }
    if head.uv is not None:
        attributes["TEXCOORD_0"] = buffer.array(np.column_stack([head.uv[:, 0], 1.0 - head.uv[:, 1]]), VERTEX_DATA)
    morphs = [
        {
            "POSITION": buffer.array(target * MM, VERTEX_DATA, bounds=True),
            "NORMAL": buffer.array(vertex_normals(head.vertices + target, head.triangles) - normals, VERTEX_DATA),
        }
        for target in targets
    ]
    materials, textures = _materials(head, buffer)
    names = [material["name"] for material in materials]
    primitives = []
    for name in names:
        parts = [part for part in head.parts if SEE_THROUGH.get(part, "OPAQUE") == name]
        indices = buffer.array(head.part_triangles(*parts).ravel().astype(np.uint32), INDEX_DATA)
        primitive = {"attributes": attributes, "indices": indices, "material": names.index(name)}
        primitives.append({**primitive, "targets": morphs} if morphs else primitive)
    mesh: dict[str, Any] = {"name": head.name, "primitives": primitives}
    if morphs:
        mesh["weights"] = [0.0] * len(morphs)
        mesh["extras"] = {"targetNames": [f"component {k + 1}" for k in range(len(morphs))]}
    times = buffer.array(np.arange(animation.frames) / animation.rate_hz, bounds=True)
    quaternions = quaternion_from_rotation(animation.rotations)[:, [1, 2, 3, 0]]
    tracks = [(0, "rotation", quaternions), (0, "translation", animation.translations * MM)]
    if morphs:
        tracks.append((1, "weights", weights.ravel()))
    samplers = [{"input": times, "output": buffer.array(v), "interpolation": "LINEAR"} for _, _, v in tracks]
    channels = [{"sampler": k, "target": {"node": n, "path": p}} for k, (n, p, _) in enumerate(tracks)]
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"evalkit {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "head motion", "children": [1]}, {"name": head.name, "mesh": 0}],
        "meshes": [mesh],
        "materials": materials,
        **textures,
        "animations": [{"name": "performance", "samplers": samplers, "channels": channels}],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
    }
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    return container(json.dumps(document, separators=(",", ":")).encode(), bytes(buffer.data))


def _materials(head: Head, buffer: _Buffer) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """A material for every way of drawing that a part of the head needs, and the texture that they share."""
    modes = sorted({SEE_THROUGH.get(part, "OPAQUE") for part in head.parts}, reverse=True)
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.8}
    textures: dict[str, Any] = {}
    if head.texture is not None and head.uv is not None:
        from PIL import Image

        file = io.BytesIO()
        Image.fromarray(head.texture).save(file, format="PNG")
        image = {"bufferView": buffer.view(file.getvalue()), "mimeType": "image/png", "name": "texture"}
        textures = {"images": [image], "samplers": [{"wrapS": 33071, "wrapT": 33071}]}
        textures["textures"] = [{"source": 0, "sampler": 0}]
        surface["baseColorTexture"] = {"index": 0}
    else:
        surface["baseColorFactor"] = list(PLAIN)
    # Teeth and plate are single sheets: seen from behind they must not vanish.
    return [
        {"name": mode, "pbrMetallicRoughness": surface, "alphaMode": mode, "doubleSided": True} for mode in modes
    ], textures
