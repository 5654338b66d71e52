"""The methods over what files hold."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array, nearest_rotation, rotation_angle
from evalkit.meshes.model import Mesh, seams_welded, welded
from evalkit.transfer.character import CharacterTransfer
from evalkit.transfer.choosing import choose_examples
from evalkit.transfer.correspondence import Correspondence, correspondence_of, read_correspondence
from evalkit.transfer.deformation_transfer import DeformationTransfer, still_vertices
from evalkit.transfer.files import Material, Shape, override_coefficients, read_regions
from evalkit.transfer.gradients import Indices, checked_mesh
from evalkit.transfer.methods import methods
from evalkit.transfer.registration import Surface, register
from evalkit.transfer.segmentation import LEVELS

CHARACTER_TRANSFER = "character transfer"
"""The method whose regions and coefficients can be seen and overridden."""

OFFERED = tuple(name for name in methods if name != "hand-drawn regions")
"""Methods that need nothing but the meshes; with a file of regions Character Transfer is the one left out."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Results of a method.

    Attributes
    ----------
    method : str
    shapes : ndarray, shape (N, U, 3)
        Fine shapes with seams welded.
    regions : dict of str to ndarray of int
        Vertices of the files, by region; empty for methods without.
    weights : ndarray, shape (N, R, M), optional
        Coefficients.
    overridden : int
        So many of them a user has changed.
    pinned : ndarray of bool, shape (U,), optional
    """

    method: str
    shapes: Array
    regions: dict[str, Indices] = field(default_factory=dict)
    weights: Array | None = None
    overridden: int = 0
    pinned: NDArray[np.bool_] | None = None


def transferred(
    material: Material, method: str = CHARACTER_TRANSFER, regions: Path | None = None, coefficients: Path | None = None
) -> Outcome:
    """Fine shapes of all new rough ones.

    Parameters
    ----------
    material : Material
    method : str
        Of :data:`OFFERED`.
    regions, coefficients : Path, optional
        Files of :func:`~evalkit.transfer.files.read_regions` and
        :func:`~evalkit.transfer.files.override_coefficients`.

    Raises
    ------
    EvalkitError
        If the method is not known or takes no regions or coefficients, or a file or an example cannot be used.
    """
    if method not in OFFERED:
        raise EvalkitError(f"no method '{method}'; there are {', '.join(OFFERED)}")
    if method != CHARACTER_TRANSFER and (regions or coefficients):
        raise EvalkitError(f"regions and coefficients of a file go with the method '{CHARACTER_TRANSFER}' alone")
    new = material.stacked(material.new)
    drawn, names = _drawn(material, regions)
    examples = material.examples(drawn)
    try:
        if method != CHARACTER_TRANSFER:
            return Outcome(method, methods[method](examples, new))
        transfer = CharacterTransfer(
            examples.rest, examples.rough, examples.fine, examples.triangles,
            regions=LEVELS if examples.hand_drawn is None else examples.hand_drawn,
        )  # fmt: skip
    except EvalkitError as error:
        # The method counts its examples, a user knows them by their files.
        raise EvalkitError(
            re.sub(r"^rough example (\d+)", lambda found: str(material.rough[int(found[1])]), str(error))
        ) from error
    estimated = weights = transfer.coefficients(new)
    names = names or [str(k) for k in range(weights.shape[1])]
    if coefficients is not None:
        rows, columns = ([shape.name for shape in shapes] for shapes in (material.new, material.rough))
        weights = override_coefficients(coefficients, weights, rows, names, columns)
    of_files = transfer.regions[material.of]
    return Outcome(
        method, transfer(new, weights), {name: np.flatnonzero(of_files == k) for k, name in enumerate(names)}, weights,
        int((weights != estimated).sum()), transfer.pinned,
    )  # fmt: skip


def _drawn(material: Material, path: Path | None) -> tuple[NDArray[np.intp] | None, list[str]]:
    """A user's region of each vertex, and the regions' names."""
    if path is None:
        return None, []
    given = read_regions(path, len(material.of))
    drawn = np.zeros(len(material.of), dtype=np.intp)
    for k, which in enumerate(given.values()):
        drawn[which] = k
    # A region may be gone whose every vertex lies on a vertex of another.
    return drawn, [list(given)[k] for k in np.unique(drawn[material.kept])]


@dataclass(frozen=True, eq=False)
class Deformed:
    """Shapes of another mesh.

    Attributes
    ----------
    shapes : ndarray, shape (N, V, 3)
        Of the target's file.
    correspondence : Correspondence
        Of the two meshes' triangles, seams welded.
    pinned : ndarray of bool, shape (V,)
        Vertices that no shape moves.
    """

    shapes: Array
    correspondence: Correspondence
    pinned: NDArray[np.bool_]


def deformed(source: Surface, shapes: Array, target: Surface, kept: Path | None = None) -> Deformed:
    """Shapes of the source for the target, by Deformation Transfer.

    Parameters
    ----------
    source, target : Surface
        At rest, with landmarks of the same names.
    shapes : ndarray, shape (N, V, 3)
        Of the source.
    kept : Path, optional
        A correspondence that was saved; landmarks are not needed then.

    Raises
    ------
    EvalkitError
        If a mesh is broken, landmarks do not suffice or the correspondence is for other meshes.
    """
    for surface in (source, target):
        checked_mesh(surface.vertices, surface.triangles, surface.name)
    (one, first, _), (other, _, of) = (_welded(surface) for surface in (source, target))
    if kept is None:
        correspondence = correspondence_of(replace(one, vertices=register(one, other)), other)
    else:
        correspondence = read_correspondence(kept, one.triangles, other.triangles)
    given = shapes[:, first]
    still = still_vertices(one.vertices, one.triangles, given, other.triangles, correspondence)
    # Vertices beyond those of the triangles move with nothing.
    pinned = np.ones(len(other.vertices), dtype=bool)
    pinned[: len(still)] = still
    transfer = DeformationTransfer(
        one.vertices, one.triangles, other.vertices, other.triangles, correspondence, pinned
    )  # fmt: skip
    return Deformed(transfer.transfer(given)[:, of], correspondence, pinned[of])


def _welded(surface: Surface) -> tuple[Surface, Indices, Indices]:
    kept, of = seams_welded(surface.vertices, surface.triangles)
    labels = None if surface.labels is None else surface.labels[kept]
    whole = replace(surface, vertices=surface.vertices[kept], triangles=of[surface.triangles], labels=labels)
    return whole, kept, of


def turned_apart(source: Surface, target: Surface) -> float:
    """Degrees between the ways in which two meshes face, by the landmarks that both have; 0 without three."""
    names = sorted(set(source.landmarks) & set(target.landmarks))
    if len(names) < 3:
        return 0.0
    a, b = (np.array([surface.landmarks[name] for name in names]) for surface in (source, target))
    return float(np.degrees(rotation_angle(nearest_rotation((b - b.mean(axis=0)).T @ (a - a.mean(axis=0))))))


def chosen(rest: Mesh, shapes: Sequence[Shape], count: int) -> list[Shape]:
    """Rough shapes that an artist should sculpt, most useful first.

    Raises
    ------
    EvalkitError
        If the mesh or a shape cannot be used, or there are fewer shapes than asked for.
    """
    triangles, places = rest.triangles(), np.stack([shape.places for shape in shapes])
    checked_mesh(rest.vertices, triangles, str(rest.path))
    kept, of = welded(np.concatenate([rest.vertices[None], places]))
    order = choose_examples(rest.vertices[kept], places[:, kept], of[triangles], count)
    return [shapes[k] for k in order]
