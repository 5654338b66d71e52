"""Character Transfer over what files hold, with the regions and coefficients that a user overrides."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.transfer.character import CharacterTransfer
from evalkit.transfer.files import Material, override_coefficients, read_regions
from evalkit.transfer.gradients import Indices
from evalkit.transfer.methods import methods
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
