"""The linear map from marker displacements to vertex displacements, built once for a rest pose."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from evalkit.deform.centres import (
    EYES,
    Centres,
    HeadLike,
    inter_eye_distance,
    locate,
    site_positions,
    soft_mesh,
    static_positions,
)
from evalkit.deform.kernels import Kernel, Sites, euclidean, kernels
from evalkit.deform.regions import LIP_SITES, LIPS, Seams, seam_treatments
from evalkit.deform.surface import edge_graph, nearest_vertices
from evalkit.errors import EvalkitError
from evalkit.geometry import Array

RAMP = 0.165
"""Default width of the blend between regions, as a fraction of the inter-eye distance: 11 mm on an average face,
a good third of the way from a corner of the mouth to its middle."""

REACH = 0.5
"""A centre without a name plays the part of the nearest marker site up to this fraction of the inter-eye distance."""

CORNER_REACH = 0.25
"""The same for the corners of the mouth, to which both lips listen: half of it, as a marker of the cheek or the jaw
that is farther away would pull at the wrong lip."""

SLOPES = {"face": 3, "upper lip": 1, "lower lip": 2}
"""Directions in which a field's affine part may have a slope. The few markers of a lip lie on one patch of skin: a
slope through it would be read off the patch's curvature, and would move the inside of the mouth by ten times what
the markers move. From lip to chin the jaw's turn is a slope; from cheek to lip there is no such thing, and what the
corners do below the cheeks would be carried on to the edge of the lip."""

ACROSS_LIP = 0.3
"""Part that a length across a lip counts in the lip's field; one from corner to corner counts in full. A lip is a
band whose markers are in the skin beside it, as far from its edge as from each other: by plain distance the edge
would follow the corners nearly as much as the marker beside it. With less than this, the kink that the exponential
has at a marker becomes a crease through the whole lip."""

BADLY_CONDITIONED = 1e12
"""Condition number above which four or fewer digits of the weights can be trusted."""


AMPLIFIES = 25.0
"""Amplification that is worth a note: half a millimetre of noise on a marker is then a centimetre at a vertex."""


@dataclass(frozen=True, eq=False)
class Field:
    """One interpolant of a map.

    Attributes
    ----------
    region : str
    centres : tuple of str
        The moving centres it listens to.
    static : int
        Number of static centres besides.
    condition : float
        Condition number of its linear system, lengths in inter-eye distances.
    affine_rank : int
        Directions in which its affine part has a slope; fewer than the kernel's three where the centres are in
        one plane or line.
    truncated : int
        Dimensions of the data that are not interpolated since double precision cannot tell them apart.
    amplification : float
        Largest sum of absolute weights of a vertex: how much larger than a marker's error a vertex's can be.
    """

    region: str
    centres: tuple[str, ...]
    static: int
    condition: float
    affine_rank: int
    truncated: int
    amplification: float


@dataclass(frozen=True, eq=False)
class Deformation:
    """A deformation map with what it was made of.

    Attributes
    ----------
    weights : ndarray, shape (V, n)
        Vertex displacement = weights @ marker displacement.
    labels : tuple of str, length n
    centres, static : ndarray, shape (n, 3) and (k, 3), in the head's unit
    kernel, seam : str
    scale_mm : float or None
        Length of the kernel in the head's unit, None if it has none.
    inter_eye_mm : float
        Distance that lengths are measured by, in the head's unit.
    fields : tuple of Field
    notes : tuple of str
        What a user should know, one line each.
    """

    weights: Array
    labels: tuple[str, ...]
    centres: Array
    static: Array
    kernel: str
    seam: str
    scale_mm: float | None
    inter_eye_mm: float
    fields: tuple[Field, ...]
    notes: tuple[str, ...]


def deformation_map(
    head: HeadLike,
    centres: Centres,
    kernel: str | Kernel = "exponential",
    regions: bool | Mapping[str, Sequence[str | int]] = True,
    static: bool | Centres = True,
    *,
    seam: str = "ramp",
    scale_mm: float | None = None,
    ramp_mm: float | None = None,
) -> Array:
    """Matrix from marker displacements to vertex displacements.

    The map depends on the rest pose alone: build it once, then every frame is one matrix product, which
    :class:`~evalkit.deform.Deformer` takes in batches.

    Parameters
    ----------
    head : HeadLike
        Such as :func:`evalkit.load_head` gives.
    centres : sequence of str, mapping of str to position, or array_like, shape (n, 3), mm
        Markers on the head at rest: names of its marker sites, or positions in its axes and unit.
    kernel : str or Kernel
        Name in :data:`evalkit.kernels`.
    regions : bool or mapping of str to centres
        Whether the lips listen to markers of their own (Huang et al. 2000, section 4.2). In a lip's field of
        straight distance, lengths across the lip count `ACROSS_LIP` of what they are. A mapping says which
        centres, by label or index, ``"upper lip"`` and ``"lower lip"`` listen to; True goes by the names of the
        marker sites, or the sites nearest to centres without a known name.
    static : bool or centres
        Centres that never move. True spreads 20 of them over the head's hindbrain and neck. They act on the face
        and have no column in the result.
    seam : str
        How the fields of the regions meet: ``ramp`` over surface distance, ``spline`` along the lips' outline as
        in the paper, ``hard`` with a jump, or ``none``, one field for all.
    scale_mm : float, optional
        Length of the kernel, in the head's unit; by default the kernel's own fraction of the inter-eye distance.
    ramp_mm : float, optional
        Width of the blend between regions, in the head's unit; by default `RAMP` inter-eye distances.

    Returns
    -------
    ndarray, shape (V, n)
        Vertex displacement (V, 3) = weights @ marker displacement (n, 3). Without unit: a head and centres in
        metres give the same. Zero for vertices outside the head's regions, such as teeth and eyeballs.

    Raises
    ------
    EvalkitError
        If a centre, kernel, region or option is unknown or useless; the line says which.

    References
    ----------
    Huang, Lin & Ouhyoung 2000, section 4.1, Eq. (10-11), and section 4.2.

    Examples
    --------
    The left brow goes up by 5 mm; the skin beside that marker follows, the chin and the other brow stay:

    >>> import numpy as np
    >>> import evalkit
    >>> head = evalkit.load_head("template")
    >>> sites = list(head.marker_sites)
    >>> weights = evalkit.deformation_map(head, sites, kernel="exponential")
    >>> weights.shape
    (11272, 23)
    >>> displacements = np.zeros((23, 3))
    >>> displacements[sites.index("BrowInL")] = 0, 5, 0
    >>> moved = weights @ displacements
    >>> near = head.nearest_vertices(head.marker_sites)
    >>> [round(float(moved[near[name], 1]), 1) + 0 for name in ("BrowInL", "BrowInR", "Chin")]
    [4.9, 0.0, 0.0]
    """
    return deformation_report(
        head, centres, kernel, regions, static, seam=seam, scale_mm=scale_mm, ramp_mm=ramp_mm
    ).weights


def deformation_report(
    head: HeadLike,
    centres: Centres,
    kernel: str | Kernel = "exponential",
    regions: bool | Mapping[str, Sequence[str | int]] = True,
    static: bool | Centres = True,
    *,
    seam: str = "ramp",
    scale_mm: float | None = None,
    ramp_mm: float | None = None,
) -> Deformation:
    """The map of :func:`deformation_map` with the centres, conditions and notes that belong to it."""
    name, entry = kernel_named(kernel)
    if seam not in seam_treatments:
        raise EvalkitError(f"unknown seam '{seam}'; known are {', '.join(seam_treatments)}")
    labels, positions = locate(head, centres)
    eyes = inter_eye_distance(head)
    scale = _length("scale_mm", scale_mm, entry.scale, eyes)
    width = _length("ramp_mm", ramp_mm, RAMP, eyes) or RAMP
    still = static_positions(head, static, positions)
    skin = soft_mesh(head)
    vertices = skin.vertices / eyes
    listens = {"face": np.arange(len(labels))}
    if regions is not False and seam != "none":
        listens |= _lip_centres(head, labels, positions, eyes, regions)
    else:
        seam = "none"
    maps: dict[str, Array] = {}
    fields: list[Field] = []
    notes: list[str] = []
    for region, which in listens.items():
        if not which.size:
            maps[region] = maps["face"]
            notes.append(f"{region}: none of its markers is among the centres; it listens to all of them")
            continue
        fixed = still if region == "face" else still[:0]
        names = [labels[i] for i in which]
        sites = _sites(vertices, skin.triangles, np.vstack([positions[which], fixed]) / eyes, names, entry)
        if region != "face" and entry.weights is None and entry.distances is None:
            sites = _along_the_lip(head, sites)
        found = entry.interpolate(sites, scale, _slopes(entry, region))
        moving = found.weights[:, : len(which)]
        maps[region] = np.zeros((len(vertices), len(labels)))
        maps[region][:, which] = moving
        used = moving if region == "face" else moving[skin.member(region)]
        fields.append(
            Field(
                region=region,
                centres=tuple(names),
                static=len(fixed),
                condition=found.condition,
                affine_rank=found.affine_rank,
                truncated=found.truncated,
                amplification=float(np.abs(used).sum(axis=1).max()),
            )
        )
        notes += _notes(fields[-1], entry)
    if seam == "none":
        blended = maps["face"]
    else:
        member = {lip: skin.member(lip) for lip in LIPS}
        blended = seam_treatments[seam](maps, Seams(vertices, edge_graph(vertices, skin.triangles), member, width))
    weights = np.zeros((len(head.vertices), len(labels)))
    weights[skin.indices] = blended
    if not len(still) and static is True:
        notes.append("the head has no hindbrain and no neck region: nothing holds its back still")
    return Deformation(
        weights, labels, positions, still, name, seam, scale and scale * eyes, eyes, tuple(fields), tuple(notes)
    )


def kernel_named(kernel: str | Kernel) -> tuple[str, Kernel]:
    """Name and entry of a kernel, or one line with the names that are near."""
    if isinstance(kernel, Kernel):
        return kernel.summary, kernel
    if kernel not in kernels:
        near = difflib.get_close_matches(str(kernel).lower().replace("_", "-"), kernels, n=2, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(kernels)}"
        raise EvalkitError(f"unknown kernel '{kernel}'; {hint}")
    return kernel, kernels[kernel]


def fill_missing(
    head: HeadLike,
    centres: Centres,
    displacement: Array,
    kernel: str | Kernel = "exponential",
    static: bool | Centres = True,
    *,
    scale_mm: float | None = None,
) -> Array:
    """Displacements of missing markers from those that are seen, by the same interpolation.

    A radial-basis interpolant does not change when a value is added that lies on it. So a map applied to the
    result moves the face as a map would that was built without the missing markers.

    Parameters
    ----------
    head, centres, kernel, static, scale_mm
        As for :func:`deformation_map`. Of the kernels, one made of radial functions of straight distance.
    displacement : array_like, shape (F, n, 3), mm
        NaN where a marker is missing.

    Returns
    -------
    ndarray, shape (F, n, 3), mm
        NaN only in frames in which no marker is seen.

    Raises
    ------
    EvalkitError
        If shapes do not fit or the kernel works on the surface.
    """
    name, entry = kernel_named(kernel)
    if entry.weights is not None or entry.distances is not None:
        raise EvalkitError(f"kernel '{name}' cannot fill missing markers; take one of straight distance")
    labels, positions = locate(head, centres)
    eyes = inter_eye_distance(head)
    scale = _length("scale_mm", scale_mm, entry.scale, eyes)
    u = np.array(displacement, dtype=np.float64)
    if u.ndim != 3 or u.shape[1:] != (len(labels), 3):
        raise EvalkitError(f"displacements have shape {u.shape}; expected (frames, {len(labels)}, 3)")
    still = static_positions(head, static, positions)
    seen = np.asarray(np.isfinite(u).all(axis=2))
    u[~seen] = np.nan
    for pattern in np.unique(seen[~seen.all(axis=1) & seen.any(axis=1)], axis=0):
        frames = np.asarray((seen == pattern).all(axis=1))
        known = np.vstack([positions[pattern], still]) / eyes
        wanted = positions[~pattern] / eyes
        at, _ = nearest_vertices(wanted, known)
        weights = entry.interpolate(Sites(wanted, np.zeros((0, 3), dtype=int), known, at), scale).weights
        u[np.ix_(frames, ~pattern)] = weights[:, : pattern.sum()] @ u[np.ix_(frames, pattern)]
    return u


def _length(option: str, given: float | None, fraction: float | None, eyes: float) -> float | None:
    """A length in inter-eye distances, from what the user gave in the head's unit or from its default fraction."""
    if given is None:
        return fraction
    if not (np.isfinite(given) and given > 0):
        raise EvalkitError(f"{option} is {given}; it must be a positive length")
    if fraction is None:
        raise EvalkitError(f"{option} has no meaning for this kernel: it has no scale")
    return given / eyes


def _sites(vertices: Array, triangles: np.ndarray, centres: Array, labels: list[str], kernel: Kernel) -> Sites:
    at, _ = nearest_vertices(vertices, centres)
    on_surface = kernel.distances is not None or kernel.weights is not None
    moving = at[: len(labels)]
    if on_surface and len(np.unique(moving)) < len(moving):
        first, second = next((i, j) for j in range(len(moving)) for i in range(j) if moving[i] == moving[j])
        raise EvalkitError(
            f"centres {labels[first]} and {labels[second]} have the same nearest vertex; the mesh is too coarse for "
            "this kernel, or one of them must be left out"
        )
    if on_surface:
        # A static centre gives way to a moving one; the mesh holds no two values at a vertex.
        first_at = np.sort(np.unique(at, return_index=True)[1])
        centres, at = centres[first_at], at[first_at]
    return Sites(vertices, triangles, centres, at)


def _along_the_lip(head: HeadLike, sites: Sites) -> Sites:
    """Sites with lengths across the direction from eye to eye, which is that from corner to corner, shortened."""
    places = site_positions(head)
    axis = (places[EYES[0]] - places[EYES[1]]) / inter_eye_distance(head)
    shorten = ACROSS_LIP * np.eye(3) + (1.0 - ACROSS_LIP) * np.outer(axis, axis)
    return replace(sites, vertices=sites.vertices @ shorten, centres=sites.centres @ shorten)


def _lip_centres(
    head: HeadLike,
    labels: tuple[str, ...],
    positions: Array,
    eyes: float,
    regions: bool | Mapping[str, Sequence[str | int]],
) -> dict[str, np.ndarray]:
    """Indices of the centres that each lip listens to."""
    if isinstance(regions, Mapping):
        unknown = [name for name in regions if name not in LIPS]
        if unknown or len(regions) < len(LIPS):
            raise EvalkitError(f"regions name {', '.join(regions)}; expected {' and '.join(LIPS)}")
        return {lip: np.unique([_index(item, labels) for item in regions[lip]]).astype(int) for lip in LIPS}
    parts = _site_of_each(head, labels, positions, eyes)
    return {lip: np.flatnonzero([part in LIP_SITES[lip] for part in parts]) for lip in LIPS}


def _site_of_each(head: HeadLike, labels: tuple[str, ...], positions: Array, eyes: float) -> list[str]:
    """Marker site whose part each centre plays: its own name, else the nearest site that is near enough, else ''."""
    sites = site_positions(head)
    known = list(sites)
    gap = euclidean(positions, np.array(list(sites.values())))
    corner = np.array([all(name in LIP_SITES[lip] for lip in LIPS) for name in known])
    gap[:, corner] = np.where(gap[:, corner] <= CORNER_REACH * eyes, gap[:, corner], np.inf)
    nearest = gap.argmin(axis=1)
    return [
        label if label in sites else known[near] if gap[i, near] <= REACH * eyes else ""
        for i, (label, near) in enumerate(zip(labels, nearest, strict=True))
    ]


def _index(item: str | int, labels: tuple[str, ...]) -> int:
    if isinstance(item, str) and item in labels:
        return labels.index(item)
    if not isinstance(item, str) and 0 <= int(item) < len(labels):
        return int(item)
    raise EvalkitError(f"regions name centre {item!r}, which is not among the {len(labels)} centres")


def _slopes(kernel: Kernel, region: str) -> int:
    return 3 if (kernel.order or 0) >= 2 else SLOPES[region]


def _notes(field: Field, kernel: Kernel) -> list[str]:
    found = []
    expected = _slopes(kernel, field.region) if kernel.degree >= 1 else 0
    if field.affine_rank < expected:
        shape = ("at one place", "in one line", "in one plane")[field.affine_rank]
        found.append(f"{field.region}: its {len(field.centres) + field.static} centres are {shape}; no slope across it")
    if field.truncated:
        found.append(f"{field.region}: {field.truncated} dimensions of the data are not interpolated: scale too large")
    elif field.condition > BADLY_CONDITIONED:
        found.append(f"{field.region}: badly conditioned ({field.condition:.0e}); use a smaller scale")
    if field.amplification > AMPLIFIES:
        found.append(f"{field.region}: a vertex can err {field.amplification:.0f} times as much as a marker")
    return found
