"""Ways from rough to fine shapes behind one interface, the paper's and what it must beat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.transfer.character import CharacterTransfer, checked_examples
from evalkit.transfer.coefficients import region_coefficients
from evalkit.transfer.gradients import Indices
from evalkit.transfer.local import LocalRegression
from evalkit.transfer.rigging import example_based_rig
from evalkit.transfer.segmentation import segment, vertex_regions


@dataclass(frozen=True, eq=False)
class Examples:
    """What is known of a character.

    Attributes
    ----------
    rest : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    rough, fine : ndarray, shape (M, V, 3)
        Examples: rough shapes, and what a sculptor made of each.
    hand_drawn : ndarray of int, shape (V,), optional
        Region of each vertex as a user has drawn it.

    Raises
    ------
    EvalkitError
        If they do not fit together, or cannot be used; as :class:`~evalkit.transfer.character.CharacterTransfer` says.
    """

    rest: Array
    triangles: Indices
    rough: Array
    fine: Array
    hand_drawn: NDArray[np.intp] | None = None

    def __post_init__(self) -> None:
        checked_examples(self.rest, self.rough, self.fine, self.triangles)


Method = Callable[[Examples, Array], Array]


def unchanged(examples: Examples, new: Array) -> Array:
    """The rough shapes themselves, as Deformation Transfer or whatever made them."""
    return new.copy()


def gain(examples: Examples, new: Array) -> Array:
    """Rough displacements times one number, that with the least squares error over the examples."""
    rough, fine = examples.rough - examples.rest, examples.fine - examples.rest
    size = float((rough**2).sum())
    return np.asarray(examples.rest + ((rough * fine).sum() / size if size > 0.0 else 1.0) * (new - examples.rest))


def position_deltas(levels: int) -> Method:
    """Differences of positions between fine and rough examples, blended by the coefficients of each region."""

    def run(examples: Examples, new: Array) -> Array:
        labels = segment(examples.rest, examples.triangles, examples.fine, levels)[-1]
        regions = vertex_regions(examples.triangles, labels, len(examples.rest))
        weights = region_coefficients(examples.rough - examples.rest, new - examples.rest, regions)
        return np.asarray(new + np.einsum("nvm,mvi->nvi", weights[:, regions], examples.fine - examples.rough))

    return run


def one_region(examples: Examples, new: Array) -> Array:
    """Character Transfer with the whole face as one region."""
    return _paper(examples, regions=0)(new)


def hand_drawn_regions(examples: Examples, new: Array) -> Array:
    """Character Transfer with the regions that a user has drawn."""
    if examples.hand_drawn is None:
        raise EvalkitError("no regions are drawn; give a region for every vertex, or use 'character transfer'")
    return _paper(examples, regions=examples.hand_drawn)(new)


def character_transfer(examples: Examples, new: Array) -> Array:
    """The method of the paper: 16 regions of its own finding."""
    return _paper(examples)(new)


def rigging(examples: Examples, new: Array) -> Array:
    """Example-based facial rigging of Li et al. 2010."""
    return example_based_rig(examples.rest, examples.triangles, examples.rough, examples.fine, new)


def local_regression(examples: Examples, new: Array) -> Array:
    """Our variant: local gains and differences regressed on local motion."""
    return LocalRegression(examples.rest, examples.triangles, examples.rough, examples.fine)(new)


def _paper(examples: Examples, **options: Any) -> CharacterTransfer:
    return CharacterTransfer(examples.rest, examples.rough, examples.fine, examples.triangles, **options)


methods: dict[str, Method] = {
    "rough": unchanged,
    "gain": gain,
    "position deltas": position_deltas(4),
    "position deltas of one region": position_deltas(0),
    "one region": one_region,
    "hand-drawn regions": hand_drawn_regions,
    "example-based rigging": rigging,
    "character transfer": character_transfer,
    "local regression": local_regression,
}
