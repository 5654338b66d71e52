"""Where the centres of a map are on a head, given by the names of marker sites or as positions."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from evalkit.deform.surface import nearest_vertices, spread_out
from evalkit.errors import EvalkitError
from evalkit.geometry import Array

CLOSEST = 1e-3
"""Centres closer than this part of the inter-eye distance (0.06 mm) count as one place: markers are millimetres
wide, and a displacement that differs between them would be divided by their distance."""

FARTHEST = 1.0
"""Centres whose median distance from the head is beyond this many inter-eye distances belong to another unit."""

STATIC_REGIONS = {"hindbrain": 12, "neck": 8}
"""Region -> number of static centres that are spread over it."""

EYES = ("LidL", "LidR")
"""Marker sites whose distance is the inter-eye distance: the lower eyelids, 64 mm on an average face, which is
what the paper's length of 64 stands for."""

Centres = Sequence[str] | Mapping[str, Any] | ArrayLike


@runtime_checkable
class HeadLike(Protocol):
    """What a map needs of a head. All lengths are in the head's unit, mm for evalkit's own.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
    triangles : ndarray, shape (T, 3)
    marker_sites : mapping of str to vertex index or position (3,)
    regions : mapping of str to vertex indices
    """

    @property
    def vertices(self) -> Any: ...  # noqa: D102
    @property
    def triangles(self) -> Any: ...  # noqa: D102
    @property
    def marker_sites(self) -> Any: ...  # noqa: D102
    @property
    def regions(self) -> Any: ...  # noqa: D102


def site_positions(head: HeadLike) -> dict[str, Array]:
    """Marker site -> position (3,) on the head."""
    return {name: _position(head, place) for name, place in head.marker_sites.items()}


def inter_eye_distance(head: HeadLike) -> float:
    """Distance between the marker sites of the lower eyelids, in the head's unit.

    Raises
    ------
    EvalkitError
        If the head lacks one of them.
    """
    sites = site_positions(head)
    missing = [name for name in EYES if name not in sites]
    if missing:
        raise EvalkitError(f"the head has no marker site {missing[0]}: its inter-eye distance is unknown")
    return float(np.linalg.norm(sites[EYES[0]] - sites[EYES[1]]))


def locate(head: HeadLike, centres: Centres) -> tuple[tuple[str, ...], Array]:
    """Labels and positions (n, 3) of centres.

    Parameters
    ----------
    head : HeadLike
    centres : sequence of str, mapping of str to position or vertex, or array_like (n, 3) or (n,) of vertices
        Names are those of the head's marker sites. Positions without names are called by their index.

    Raises
    ------
    EvalkitError
        If a name is unknown, a position is not finite, two centres are at the same place, there is none, or they
        are nowhere near the head.
    """
    if isinstance(centres, Mapping):
        labels, places = tuple(centres), [_position(head, place) for place in centres.values()]
    elif not isinstance(centres, np.ndarray) and all(isinstance(name, str) for name in _listed(centres)):
        labels = tuple(str(name) for name in _listed(centres))
        sites = site_positions(head)
        places = [sites[_known(name, list(sites))] for name in labels]
    else:
        array = np.asarray(centres)
        labels = tuple(str(i) for i in range(len(array)))
        places = [_position(head, place) for place in array]
    if not labels:
        raise EvalkitError("no centres: a deformation needs at least one marker")
    positions = np.array(places, dtype=np.float64)
    _check(head, labels, positions)
    return labels, positions


def static_positions(head: HeadLike, static: bool | Centres, centres: Array) -> Array:
    """Positions (k, 3) of the centres that stay where they are.

    True spreads them over the hindbrain and the neck (`STATIC_REGIONS`); one that falls on a moving centre is left
    out. Names and positions as for :func:`locate`.
    """
    if isinstance(static, bool):
        vertices = np.asarray(head.vertices, dtype=np.float64)
        chosen = [
            vertices[np.asarray(head.regions[name])][spread_out(vertices[np.asarray(head.regions[name])], count)]
            for name, count in STATIC_REGIONS.items()
            if static and name in head.regions and len(head.regions[name])
        ]
        still = np.vstack(chosen) if chosen else np.zeros((0, 3))
    else:
        still = locate(head, static)[1] if len(_listed(static)) else np.zeros((0, 3))
    if not len(still):
        return still
    gap = nearest_vertices(centres, still)[1]
    return still[gap > CLOSEST * inter_eye_distance(head)]


@dataclass(frozen=True, eq=False)
class SoftMesh:
    """The part of a head that follows its markers, in the head's unit.

    Attributes
    ----------
    indices : ndarray, shape (S,)
        Its vertices among those of the head.
    vertices : ndarray, shape (S, 3)
    triangles : ndarray, shape (T, 3)
        Of these vertices alone.
    regions : mapping of str to ndarray
        Region -> indices among those of the head.
    """

    indices: np.ndarray
    vertices: Array
    triangles: np.ndarray
    regions: Mapping[str, np.ndarray]

    def member(self, region: str) -> np.ndarray:
        """Vertices of a region as a mask (S,).

        Raises
        ------
        EvalkitError
            If the head has no such region.
        """
        if not len(self.regions.get(region, ())):
            raise EvalkitError(f"the head has no region '{region}'; use regions=False to let one field move all of it")
        return np.isin(self.indices, self.regions[region])


def soft_mesh(head: HeadLike) -> SoftMesh:
    """The vertices within the head's regions, or all of a head without a face region, and their triangles."""
    vertices, triangles = np.asarray(head.vertices, dtype=np.float64), np.asarray(head.triangles)
    inside = np.zeros(len(vertices), dtype=bool)
    for which in head.regions.values():
        inside[np.asarray(which)] = True
    if "face" not in head.regions:
        inside[:] = True
    number = np.cumsum(inside) - 1
    return SoftMesh(
        np.flatnonzero(inside), vertices[inside], number[triangles[inside[triangles].all(axis=1)]], head.regions
    )


def _listed(centres: Any) -> Any:
    try:
        len(centres)
    except TypeError:
        raise EvalkitError(f"centres are {centres!r}; expected names, a mapping or an array (n, 3)") from None
    return [centres] if isinstance(centres, str) else centres


def _position(head: HeadLike, place: Any) -> Array:
    """Position (3,) of a vertex index or of a position."""
    try:
        value = np.asarray(place, dtype=np.float64)
    except (TypeError, ValueError):
        value = np.empty(0)
    if value.shape == (3,):
        return value
    if value.shape == () and np.asarray(place).dtype.kind in "iu":
        if not 0 <= int(place) < len(head.vertices):
            raise EvalkitError(f"vertex {int(place)} is not one of the head's {len(head.vertices)}")
        return np.asarray(head.vertices[int(place)], dtype=np.float64)
    raise EvalkitError(f"{place!r} is neither a position of three numbers nor a vertex index")


def _known(name: str, names: list[str]) -> str:
    if name in names:
        return name
    lower = {known.lower(): known for known in names}
    near = [lower[n] for n in difflib.get_close_matches(name.lower(), lower, n=2, cutoff=0.5)]
    hint = f"did you mean {' or '.join(near)}?" if near else f"the head has {', '.join(names) or 'none'}"
    raise EvalkitError(f"unknown marker site '{name}'; {hint}")


def _check(head: HeadLike, labels: tuple[str, ...], positions: Array) -> None:
    bad = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if bad.size:
        raise EvalkitError(f"centre {labels[bad[0]]} has no finite position; leave it out or fill it")
    unit = inter_eye_distance(head)
    away = float(np.median(nearest_vertices(np.asarray(head.vertices, dtype=np.float64), positions)[1]))
    if away > FARTHEST * unit:
        raise EvalkitError(
            f"the centres are {away:.4g} away from the head, whose eyes are {unit:.4g} apart; "
            "they must be on it, in its axes and its unit"
        )
    gaps = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    gaps[np.tril_indices(len(gaps))] = np.inf
    first, second = np.unravel_index(np.argmin(gaps), gaps.shape)
    if gaps[first, second] < CLOSEST * unit:
        raise EvalkitError(f"centres {labels[first]} and {labels[second]} are at the same place; leave one of them out")
