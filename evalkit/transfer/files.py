"""Shapes of a character from mesh files: what is an example, what is to be transferred, and what a user overrides."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, nearest_rotation, rotation_angle
from evalkit.head.importing import read_names, with_names
from evalkit.meshes import formats, read_mesh_file
from evalkit.meshes.model import Mesh, check_same_faces, welded
from evalkit.transfer.gradients import Indices, checked_mesh, mesh_size
from evalkit.transfer.methods import Examples
from evalkit.transfer.registration import Surface

ODD_SIZE = 2.0
"""A shape so many times larger or smaller than the rest mesh is in another unit: no expression makes a face twice as
large, and the units that programs mix up (m, cm, mm, inches) are 2.54 apart at least."""

TURNED_DEG = 10.0
"""A shape turned by more from the rest mesh, by the best fitting rotation, has head motion in it. A jaw that opens wide
turns a whole head by 4 degrees and a mask of the face alone by 6.5."""

REST_OF_MESH = "rest of the mesh"
"""Region of the vertices that a user's file names in none."""

SKIN = ("face", "neck", "hindbrain", REST_OF_MESH)
"""Regions that one surface of skin runs through."""

COEFFICIENT_COLUMNS = ("shape", "region", "example", "weight")


@dataclass(frozen=True, eq=False)
class Shape:
    """One expression.

    Attributes
    ----------
    name : str
        Of the file without its ending, or of the morph target.
    places : ndarray, shape (V, 3)
    mesh : Mesh
        The file.
    """

    name: str
    places: Array
    mesh: Mesh

    def __str__(self) -> str:
        return f"{self.mesh.path}" + (f": target '{self.name}'" if self.mesh.targets else "")


@dataclass(frozen=True, eq=False)
class Material:
    """All that is known of a character, from files of one topology.

    Attributes
    ----------
    rest : Mesh
    rough, fine : tuple of Shape
        Examples, pair by pair.
    new : tuple of Shape
        Rough shapes without a fine one.
    triangles : ndarray of int, shape (T, 3)
        Of the vertices in the files.
    kept, of : ndarray of int, shape (U,) and (V,)
        See :func:`~evalkit.meshes.model.welded`.
    warnings : tuple of str
    """

    rest: Mesh
    rough: tuple[Shape, ...]
    fine: tuple[Shape, ...]
    new: tuple[Shape, ...]
    triangles: Indices
    kept: Indices
    of: Indices
    warnings: tuple[str, ...]

    def examples(self, regions: NDArray[np.intp] | None = None) -> Examples:
        """The examples with seams welded; regions (V,) are those of a user."""
        rough, fine = (self.stacked(shapes) for shapes in (self.rough, self.fine))
        drawn = None if regions is None else regions[self.kept]
        return Examples(self.rest.vertices[self.kept], self.of[self.triangles], rough, fine, drawn)

    def stacked(self, shapes: Sequence[Shape]) -> Array:
        """Shapes (N, U, 3) with seams welded."""
        return np.stack([shape.places for shape in shapes])[:, self.kept]


def read_material(
    rough: Sequence[Path],
    fine: Sequence[Path],
    rest: Path | None = None,
    pairs: Sequence[tuple[Path, Path]] = (),
    suffix: str | None = None,
) -> Material:
    """Examples and new shapes by their names.

    Parameters
    ----------
    rough, fine : sequence of Path
        Mesh files, folders of such, or glTF files with a morph target for each shape. Rough and fine shapes of one name
        are an example; rough shapes without a fine one are to be transferred.
    rest : Path, optional
        The rest mesh; by default that of a rough glTF file with morph targets.
    pairs : sequence of (Path, Path)
        Further examples, rough and fine, whose files have different names.
    suffix : str, optional
        Shapes among the rough ones whose name ends with it are the fine shapes of the name without it.

    Raises
    ------
    EvalkitError
        If a file cannot be read, topologies differ, a fine shape has no rough one, there is no example, or nothing to
        transfer.
    """
    coarse = read_shapes(rough, skip=rest)
    neutral = _rest_of(coarse, rest)
    sculpted = read_shapes(fine, skip=rest)
    for name in [name for name in coarse if suffix and name.endswith(suffix)]:
        shape, bare = coarse.pop(name), name.removesuffix(suffix or "")
        if bare in sculpted:
            raise EvalkitError(f"{sculpted[bare]} and {shape} are both the fine shape of '{bare}'")
        sculpted[bare] = shape
    for one, other in pairs:
        (shape,), (sculpt,) = read_shapes([one]).values(), read_shapes([other]).values()
        known = coarse.get(shape.name)
        if known is not None and not known.mesh.path.samefile(one):
            raise EvalkitError(f"{known} and {shape} have the same name; rename one")
        if shape.name in sculpted:
            raise EvalkitError(f"{sculpted[shape.name]} and {sculpt} are both the fine shape of '{shape.name}'")
        coarse[shape.name], sculpted[shape.name] = shape, sculpt
    for shape in (*coarse.values(), *sculpted.values()):
        check_same_faces(neutral, shape.mesh)
    alone = [shape for name, shape in sculpted.items() if name not in coarse]
    if alone:
        raise EvalkitError(f"{alone[0]}: no rough shape is named '{alone[0].name}'; an example needs both")
    if not sculpted:
        raise EvalkitError(
            "no example; sculpt at least one expression and give its fine shape the name of the rough one"
        )
    new = tuple(shape for name, shape in coarse.items() if name not in sculpted)
    if not new:
        raise EvalkitError("every rough shape has a fine one of its name; there is nothing to transfer")
    triangles = neutral.triangles()
    checked_mesh(neutral.vertices, triangles, str(neutral.path))
    pair = tuple(coarse[name] for name in sculpted), tuple(sculpted.values())
    every = [neutral.vertices, *(shape.places for shape in (*coarse.values(), *sculpted.values()))]
    kept, of = welded(np.stack(every))
    warnings = odd_shapes(neutral, (*coarse.values(), *sculpted.values()))
    return Material(neutral, *pair, new, triangles, kept, of, tuple(warnings))


def read_shapes(sources: Iterable[Path], skip: Path | None = None) -> dict[str, Shape]:
    """Shapes by name, in the order of the sources and of the names in a folder.

    Parameters
    ----------
    sources : iterable of Path
        As for :func:`read_material`.
    skip : Path, optional
        A file of a folder that is none of them.

    Raises
    ------
    EvalkitError
        If a file cannot be read, a folder holds none, or two shapes have one name.
    """
    out: dict[str, Shape] = {}
    for source in sources:
        files = [source]
        if source.is_dir():
            files = [p for p in sorted(source.iterdir()) if p.suffix.lower() in formats and p.name[0] != "."]
            files = [p for p in files if skip is None or not skip.exists() or not p.samefile(skip)]
            if not files:
                raise EvalkitError(f"{source}: no mesh file in this folder; known are {', '.join(formats)}")
        for file in files:
            mesh = read_mesh_file(file)
            found = mesh.targets or {file.stem: mesh.vertices}
            for name, places in found.items():
                shape = Shape(name, places, mesh)
                if name in out:
                    raise EvalkitError(f"{out[name]} and {shape} have the same name; rename one or leave it out")
                out[name] = shape
    return out


def read_source(sources: Sequence[Path], rest: Path | None = None) -> tuple[Mesh, list[Shape]]:
    """Rest mesh and shapes of another head; arguments as for :func:`read_material`.

    Raises
    ------
    EvalkitError
        If a file cannot be read or topologies differ.
    """
    shapes = read_shapes(sources, skip=rest)
    neutral = _rest_of(shapes, rest)
    for shape in shapes.values():
        check_same_faces(neutral, shape.mesh)
    return neutral, list(shapes.values())


def _rest_of(shapes: Mapping[str, Shape], rest: Path | None) -> Mesh:
    if rest is not None:
        return read_mesh_file(rest)
    bases = [shape.mesh for shape in shapes.values() if shape.mesh.targets]
    if not bases:
        raise EvalkitError("no rest mesh is named, and no glTF file with morph targets brings one; name it")
    return bases[0]


def read_surface(mesh: Mesh, names: Path | None) -> Surface:
    """A mesh with the landmarks and regions of a JSON of names, if any, in the unit of the mesh's file.

    The form is that of ``evalkit head import``; regions that it names there as parts of the skin count as such.

    Raises
    ------
    EvalkitError
        If the file cannot be read or names what is not there.
    """
    triangles = mesh.triangles()
    if names is None:
        return Surface(mesh.vertices, triangles, name=str(mesh.path))
    facts = read_names(names)
    landmarks = with_names(names, mesh.vertices, triangles, {"landmarks": facts["landmarks"]}).landmarks
    labels = None
    if facts.get("regions"):
        labels = np.full(len(mesh.vertices), "skin", dtype=object)
        for region, which in read_regions(names, len(mesh.vertices)).items():
            labels[which] = "skin" if region in SKIN else region
        labels = labels.astype(np.str_)
    return Surface(mesh.vertices, triangles, landmarks, labels, str(mesh.path))


def odd_shapes(rest: Mesh, shapes: Sequence[Shape]) -> list[str]:
    """Warnings on shapes that seem to be in another unit or to have head motion in them."""
    out = []
    size, centred = mesh_size(rest.vertices), rest.vertices - rest.vertices.mean(axis=0)
    for shape in shapes:
        ratio = mesh_size(shape.places) / size
        if not 1.0 / ODD_SIZE < ratio < ODD_SIZE:
            out.append(f"{shape} is {ratio:.3g} times as large as {rest.path}; are both in the same unit?")
            continue
        turn = nearest_rotation(centred.T @ (shape.places - shape.places.mean(axis=0)))
        angle = float(np.degrees(rotation_angle(turn)))
        if angle > TURNED_DEG:
            out.append(f"{shape} is turned by {angle:.0f} degrees from {rest.path}; take the head motion out of it")
    return out


def read_regions(path: Path, vertices: int) -> dict[str, Indices]:
    """Regions by name from JSON, ``{"regions": {"left brow": [12, 13], ...}}``, vertices from 0.

    Vertices that none names are :data:`REST_OF_MESH`.

    Raises
    ------
    EvalkitError
        If the file cannot be read, or a vertex is not there or in two regions.
    """
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise EvalkitError(f"{path}: no valid JSON ({error})") from error
    named = facts.get("regions") if isinstance(facts, dict) else None
    if not isinstance(named, dict) or not named:
        raise EvalkitError(f"{path}: 'regions' is missing: an object of names and lists of vertex numbers")
    owner = np.full(vertices, -1)
    for k, (name, which) in enumerate(named.items()):
        if not isinstance(which, list) or any(type(v) is not int for v in which):
            raise EvalkitError(f"{path}: region '{name}' must be a list of vertex numbers")
        bad = next((v for v in which if not 0 <= v < vertices), None)
        if bad is not None:
            raise EvalkitError(f"{path}: region '{name}' uses vertex {bad}, of {vertices}")
        index = np.array(which, dtype=np.intp)
        twice = index[(owner[index] >= 0) & (owner[index] != k)]
        if len(twice):
            other = list(named)[owner[twice[0]]]
            raise EvalkitError(f"{path}: vertex {twice[0]} is in the regions '{other}' and '{name}'; keep one")
        owner[index] = k
    out = {name: np.flatnonzero(owner == k) for k, name in enumerate(named)}
    left = np.flatnonzero(owner < 0)
    if len(left):
        out[REST_OF_MESH] = np.union1d(out.get(REST_OF_MESH, left), left)
    return {name: which for name, which in out.items() if len(which)}


def write_regions(path: Path, regions: Mapping[str, Indices]) -> None:
    """Regions in the form that :func:`read_regions` reads, one to a line."""
    rows = [f"    {json.dumps(name)}: {json.dumps(which.tolist())}" for name, which in regions.items()]
    path.write_text('{\n  "regions": {\n' + ",\n".join(rows) + "\n  }\n}\n", encoding="utf-8")


def override_coefficients(
    path: Path, weights: Array, shapes: Sequence[str], regions: Sequence[str], examples: Sequence[str]
) -> Array:
    """Coefficients (N, R, M) with those that a CSV file of :data:`COEFFICIENT_COLUMNS` names in their place.

    Raises
    ------
    EvalkitError
        If the file cannot be read, or a row names what is not there, is no number, or comes twice; with its line.
    """
    out, seen = weights.copy(), set()
    axes = {"shape": list(shapes), "region": list(regions), "example": list(examples)}
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file)
            if not set(COEFFICIENT_COLUMNS) <= set(rows.fieldnames or ()):
                raise EvalkitError(f"{path}: the first line must name the columns {','.join(COEFFICIENT_COLUMNS)}")
            for row in rows:
                line = f"{path}: line {rows.line_num}"
                for kind, known in axes.items():
                    if row[kind] not in known:
                        raise EvalkitError(f"{line}: no {kind} '{row[kind]}'; there are {', '.join(known[:20])}")
                at = tuple(known.index(row[kind]) for kind, known in axes.items())
                if at in seen:
                    raise EvalkitError(f"{line}: this shape, region and example have a weight already")
                seen.add(at)
                try:
                    out[at] = float(row["weight"])
                except (TypeError, ValueError):
                    raise EvalkitError(f"{line}: weight '{row['weight']}' is no number") from None
                if not np.isfinite(out[at]):
                    raise EvalkitError(f"{line}: weight '{row['weight']}' is not finite")
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise EvalkitError(f"{path}: no CSV text ({error})") from error
    return out


def write_coefficients(
    path: Path, weights: Array, shapes: Sequence[str], regions: Sequence[str], examples: Sequence[str]
) -> None:
    """Coefficients in the form that :func:`override_coefficients` reads."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COEFFICIENT_COLUMNS)
        for (n, r, m), weight in np.ndenumerate(weights):
            table.writerow((shapes[n], regions[r], examples[m], repr(float(weight))))
