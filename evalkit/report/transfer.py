"""The folder of transferred shapes: meshes, what a user may edit and give back, the measures, and pictures."""

from __future__ import annotations

import inspect
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from evalkit import __version__
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.mesh import components
from evalkit.meshes.model import Mesh, check_same_faces
from evalkit.render.error_maps import Column, Part, error_columns, sheets
from evalkit.results import file_sha256, write_json
from evalkit.transfer.character import CharacterTransfer
from evalkit.transfer.files import Material, Shape, read_shapes, read_surface, write_coefficients, write_regions
from evalkit.transfer.gradients import flipped
from evalkit.transfer.run import CHARACTER_TRANSFER, Deformed, Outcome

INNER_CORNERS = ("eye inner left", "eye inner right")

CORRESPONDENCE = "correspondence.npz"

FILES = ("summary.json", "regions.json", "coefficients.csv", CORRESPONDENCE)
"""What may be written beside the meshes and the pictures ``sheet-1.png``, ..."""


def output_names(material: Material) -> dict[str, Mesh]:
    """Files that the results go to, and the rough file that each is made from.

    Raises
    ------
    EvalkitError
        If two would have one name.
    """
    out: dict[str, Mesh] = {}
    for shape in material.new:
        other = out.setdefault(shape.mesh.path.name, shape.mesh)
        if other is not shape.mesh:
            raise EvalkitError(f"{other.path} and {shape.mesh.path} have the same name; rename one")
    return out


def protect_inputs(output: Path, names: Sequence[str], inputs: Sequence[Path]) -> None:
    """Refuse to write over a file that is read.

    Raises
    ------
    EvalkitError
        If a file of these names in the output folder is one of the inputs.
    """
    for name in names:
        if (target := output / name).exists():
            for path in inputs:
                if path.exists() and target.samefile(path):
                    raise EvalkitError(f"{path}: the result would overwrite its own input; choose another folder")


def read_references(sources: Sequence[Path], material: Material) -> list[Shape | None]:
    """The reference of each new shape, by name; those of other names are left aside.

    Raises
    ------
    EvalkitError
        If a file cannot be read, a topology differs, or no name is that of a new shape.
    """
    known = read_shapes(sources, skip=material.rest.path) if sources else {}
    out = [known.get(shape.name) for shape in material.new]
    for shape in out:
        if shape is not None:
            check_same_faces(material.rest, shape.mesh)
    if known and not any(out):
        raise EvalkitError(f"{sources[0]}: no reference has the name of a shape that is transferred")
    return out


def eye_distance(names: Path, rest: Mesh) -> float:
    """Between the inner corners of the eyes, in the unit of the mesh's file, from a JSON of names.

    Raises
    ------
    EvalkitError
        If the file cannot be read or lacks one of the two.
    """
    places = read_surface(rest, names).landmarks
    missing = [name for name in INNER_CORNERS if name not in places]
    if missing:
        raise EvalkitError(f"{names}: the landmark '{missing[0]}' is missing")
    return float(np.linalg.norm(np.subtract(*(places[name] for name in INNER_CORNERS))))


def summary(
    material: Material, outcome: Outcome, references: Sequence[Shape | None] = (), eye_distance: float | None = None
) -> dict[str, Any]:
    """What a machine may want to know: method, files with their checksums, coefficients, turned triangles, errors.

    Parameters
    ----------
    material : Material
    outcome : Outcome
    references : sequence of Shape or None
        See :func:`read_references`.
    eye_distance : float, optional
        Between the inner corners of the eyes, in the unit of the files.

    Returns
    -------
    dict
        Lengths are in the unit of the files; rms over all vertices. ``loose_parts`` are connected parts without a
        pinned vertex: each is put so that the mean of its vertices is where the blended examples have it.
    """
    rest, faces = material.rest.vertices[material.kept], material.of[material.triangles]
    rough = material.stacked(material.new)
    turned, before = (flipped(rest, shapes, faces).sum(axis=1) for shapes in (outcome.shapes, rough))
    goals = list(references) or [None] * len(rough)
    shapes = [
        {
            "name": shape.name, **_source(shape), "written": shape.mesh.path.name,
            "flipped_triangles": int(turned[k]), "flipped_triangles_of_rough": int(before[k]),
            **_errors(outcome.shapes[k][material.of], shape.places, goals[k], eye_distance),
        }
        for k, shape in enumerate(material.new)
    ]  # fmt: skip
    parts, part = components(faces)
    loose = None
    if outcome.pinned is not None:
        loose = parts - len(np.unique(part[outcome.pinned[faces].any(axis=1)]))
    return {
        "evalkit": __version__,
        "method": {"name": outcome.method, **_parameters(outcome)},
        "mesh": {
            "file": material.rest.path.as_posix(), "sha256": file_sha256(material.rest.path),
            "vertices": len(material.of), "faces": len(material.rest.sizes), "triangles": len(faces),
            "vertices_welded": len(material.of) - len(material.kept), "parts": parts, "loose_parts": loose,
            "pinned_vertices": None if outcome.pinned is None else int(outcome.pinned[material.of].sum()),
        },
        "eye_distance": eye_distance,
        "examples": [
            {"name": rough.name, "rough": _source(rough), "fine": _source(fine)}
            for rough, fine in zip(material.rough, material.fine, strict=True)
        ],
        "shapes": shapes,
        "coefficients": _coefficients(material, outcome),
        "coefficients_overridden": outcome.overridden,
        "warnings": list(material.warnings),
        "versions": _versions(),
    }  # fmt: skip


def _parameters(outcome: Outcome) -> dict[str, Any]:
    if outcome.method != CHARACTER_TRANSFER:
        return {}
    options = inspect.signature(CharacterTransfer).parameters.values()
    given = {option.name: option.default for option in options if option.kind is option.KEYWORD_ONLY}
    return {**given, "regions": {name: len(which) for name, which in outcome.regions.items()}}


def _coefficients(material: Material, outcome: Outcome) -> dict[str, Any] | None:
    if outcome.weights is None:
        return None
    examples = [shape.name for shape in material.rough]
    return {
        shape.name: {
            region: dict(zip(examples, row, strict=True)) for region, row in zip(outcome.regions, rows, strict=True)
        }
        for shape, rows in zip(material.new, outcome.weights.tolist(), strict=True)
    }


def _source(shape: Shape) -> dict[str, str]:
    return {"file": shape.mesh.path.as_posix(), "sha256": file_sha256(shape.mesh.path)}


def _errors(result: Array, rough: Array, goal: Shape | None, eye_distance: float | None) -> dict[str, Any]:
    """Of the result and of the rough shape it is made from; None where there is nothing to compare with."""
    out: dict[str, Any] = {"reference": None if goal is None else goal.mesh.path.as_posix()}
    for name, places in (("rms", result), ("rms_of_rough", rough)):
        rms = None if goal is None else float(np.sqrt(((places - goal.places) ** 2).sum(axis=1).mean()))
        out[name] = rms
        out[f"{name}_over_eye_distance"] = rms / eye_distance if rms is not None and eye_distance else None
    return out


def _versions() -> dict[str, str]:
    return {"python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__}


def write_transferred(material: Material, outcome: Outcome, content: Mapping[str, Any], folder: Path) -> None:
    """Write the meshes, summary.json and, of Character Transfer, regions.json and coefficients.csv.

    A glTF file with morph targets comes back with the results and the fine examples in place of the rough targets.
    """
    results = dict(zip((shape.name for shape in material.new), outcome.shapes[:, material.of], strict=True))
    fine = {rough.name: shape.places for rough, shape in zip(material.rough, material.fine, strict=True)}
    for name, mesh in output_names(material).items():
        own = {target: results.get(target, fine.get(target)) for target in mesh.targets}
        places = mesh.vertices if own else results[Path(name).stem]
        changed = {target: shape for target, shape in own.items() if shape is not None}
        (folder / name).write_bytes(mesh.rewritten(places, changed))
    if outcome.weights is not None:
        names = ([shape.name for shape in shapes] for shapes in (material.new, material.rough))
        rows, columns = names
        write_coefficients(folder / "coefficients.csv", outcome.weights, rows, list(outcome.regions), columns)
        write_regions(folder / "regions.json", outcome.regions)
    write_json(dict(content), folder / "summary.json")


def transfer_columns(material: Material, outcome: Outcome, references: Sequence[Shape | None]) -> list[Column]:
    """Pictures of rough shapes and results, and of references and errors where there are any."""
    goals = [None if shape is None else shape.places[material.kept] for shape in references]
    faces = material.of[material.triangles]
    return error_columns(
        material.rest.vertices[material.kept], material.stacked(material.new), outcome.shapes, faces,
        goals or [None] * len(material.new),
    )  # fmt: skip


def deformed_summary(
    shapes: Sequence[Shape], source: Mesh, target: Mesh, done: Deformed, warnings: Sequence[str]
) -> dict[str, Any]:
    """What a machine may want to know of shapes that Deformation Transfer has made."""
    triangles = target.triangles()
    turned = flipped(target.vertices, done.shapes, triangles).sum(axis=1)
    return {
        "evalkit": __version__,
        "method": {"name": "deformation transfer", "triangle_pairs": len(done.correspondence.source)},
        **{
            name: {
                "file": mesh.path.as_posix(), "sha256": file_sha256(mesh.path), "vertices": len(mesh.vertices),
                "faces": len(mesh.sizes),
            }
            for name, mesh in (("source", source), ("target", target))
        },
        "pinned_vertices": int(done.pinned.sum()),
        "shapes": [
            {
                "name": shape.name, **_source(shape), "written": shape.name + target.path.suffix,
                "flipped_triangles": int(turned[k]),
            }
            for k, shape in enumerate(shapes)
        ],
        "warnings": list(warnings),
        "versions": _versions(),
    }  # fmt: skip


def write_deformed(
    shapes: Sequence[Shape], target: Mesh, done: Deformed, content: Mapping[str, Any], folder: Path
) -> None:
    """Write a mesh for each shape, correspondence.npz and summary.json."""
    for shape, places in zip(shapes, done.shapes, strict=True):
        (folder / (shape.name + target.path.suffix)).write_bytes(target.rewritten(places, {}))
    done.correspondence.save(folder / CORRESPONDENCE)
    write_json(dict(content), folder / "summary.json")


def deformed_columns(shapes: Sequence[Shape], source: Mesh, target: Mesh, done: Deformed) -> list[Column]:
    """Pictures of the source's shapes and of what was made of them."""
    given = np.stack([shape.places for shape in shapes])
    return [
        Column(title, [*places], mesh.triangles(), Part.moving(mesh.vertices, places))
        for title, mesh, places in (("source", source, given), ("result", target, done.shapes))
    ]


def write_sheets(
    names: Sequence[str],
    columns: Sequence[Column],
    folder: Path,
    up: str = "y",
    drawn: Callable[[int], object] = lambda rows: None,
) -> None:
    """Write sheet-1.png and so on; ``drawn`` is called after each with the number of its shapes.

    Raises
    ------
    EvalkitError
        If nothing can be drawn without a screen here.
    """
    from PIL import Image

    for k, picture in enumerate(sheets(names, columns, up, drawn), 1):
        Image.fromarray(picture).save(folder / f"sheet-{k}.png", optimize=True)
