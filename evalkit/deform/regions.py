"""Which vertices listen to which markers: face, upper lip and lower lip, and the seams between them.

Huang, Lin & Ouhyoung 2000, section 4.2. The face listens to all centres, static ones included; the upper lip to
the markers of the upper mouth and the cheeks; the lower lip to those of the lower mouth and the chin. The markers
at the corners of the mouth belong to both lips.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline
from scipy.sparse.csgraph import dijkstra

from evalkit.deform.centres import HeadLike, soft_mesh
from evalkit.deform.surface import edge_distance, edge_graph, edges
from evalkit.geometry import Array

LIPS = ("upper lip", "lower lip")

LIP_SITES: dict[str, tuple[str, ...]] = {
    "upper lip": ("UpperLipC", "UpperLipL", "UpperLipR", "MouthL", "MouthR", "CheekL", "CheekR"),
    "lower lip": ("LowerLipC", "LowerLipL", "LowerLipR", "MouthL", "MouthR", "Chin"),
}
"""Marker sites that a lip listens to."""


@dataclass(frozen=True, eq=False)
class Seams:
    """What a seam treatment may look at. Lengths are in inter-eye distances.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
    graph : sparse array, shape (V, V)
        Lengths of the edges.
    member : mapping of str to ndarray, shape (V,) bool
        The vertices of each lip.
    width : float
        Surface distance over which fields are blended.
    """

    vertices: Array
    graph: sp.csr_array
    member: Mapping[str, np.ndarray]
    width: float

    def beside(self, which: np.ndarray) -> np.ndarray:
        """Vertices (V,) bool that are among those of a mask or share an edge with one."""
        return which | (self.graph.astype(bool) @ which > 0)

    def corners(self) -> np.ndarray:
        """Vertices (V,) bool where the lips meet: those that belong to or touch both lips."""
        return self.beside(self.member["upper lip"]) & self.beside(self.member["lower lip"])


def smoothstep(x: Array) -> Array:
    """``3 x^2 - 2 x^3`` between 0 and 1, constant outside: no kink at either end."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def one_field(fields: Mapping[str, Array], seams: Seams) -> Array:
    """No regions: every vertex listens to all centres."""
    return fields["face"]


def hard(fields: Mapping[str, Array], seams: Seams) -> Array:
    """Every vertex listens to the field of its own region; the fields meet with a jump."""
    weights = fields["face"].copy()
    for lip in LIPS:
        weights[seams.member[lip]] = fields[lip][seams.member[lip]]
    return weights


def ramp(fields: Mapping[str, Array], seams: Seams) -> Array:
    """The lips' fields fade into each other towards the corners and into the face's around the lips.

    The lips' fields have the share ``1 - s(d_lips)`` together, s a smooth step of the surface distance over the width.
    Between the two lips it is shared out by the squared distance from the other one, and evenly where they meet:
    ``1/2 + s(d_corner) (d_lower^2 / (d_upper^2 + d_lower^2) - 1/2)`` for the upper lip.
    """
    corner = smoothstep(edge_distance(seams.graph, np.flatnonzero(seams.corners())) / seams.width)
    far = 2.0 * seams.width
    apart = [np.minimum(edge_distance(seams.graph, np.flatnonzero(seams.member[lip]), limit=far), far) for lip in LIPS]
    share = 1.0 - smoothstep(np.minimum(*apart) / seams.width)
    touched = np.flatnonzero(share > 0)
    upper, lower = (distance[touched] ** 2 for distance in apart)
    part = 0.5 + corner[touched] * (lower / np.maximum(upper + lower, 1e-300) - 0.5)
    face = fields["face"]
    weights = face.copy()
    for lip, own in zip(LIPS, (part, 1.0 - part), strict=True):
        weights[touched] += (share[touched] * own)[:, None] * (fields[lip] - face)[touched]
    return weights


def spline(fields: Mapping[str, Array], seams: Seams) -> Array:
    """The paper's way: the displacements along the lips' outline are those of one closed cubic B-spline.

    The outline is where a lip touches another region. The spline is fitted by least squares to the mean of the
    fields that meet there, with knots a blending width apart, so it rounds the corners of the mouth; the vertices
    on either side are drawn to it within the width.
    """
    weights = hard(fields, seams)
    mouth = seams.member["upper lip"] | seams.member["lower lip"]
    outline = np.flatnonzero(mouth & (seams.beside(~mouth) | seams.corners()))
    if len(outline) < 4:
        return weights
    curve = _closed_spline(seams.vertices[outline], seams.width)
    touching = {region: seams.beside(~mouth if region == "face" else seams.member[region]) for region in fields}
    shares = np.array([touching[region][outline] for region in fields], dtype=float)
    shares /= shares.sum(axis=0)
    mean = sum(share[:, None] * fields[region][outline] for share, region in zip(shares, fields, strict=True))
    target = curve @ np.linalg.lstsq(curve, mean, rcond=None)[0]
    distance = dijkstra(seams.graph, directed=False, indices=outline, limit=seams.width)
    touched = np.isfinite(distance).any(axis=0)
    distance = distance[:, touched]
    # A mean over the outline, weighted by nearness, has no jump where the nearest point of it changes.
    near = 1.0 / (distance**2 + (0.02 * seams.width) ** 2)
    near /= near.sum(axis=0)
    fade = 1.0 - smoothstep(distance.min(axis=0) / seams.width)
    for region in ("face", *LIPS):
        own = (seams.member[region] if region in LIPS else ~mouth)[touched]
        pull = near[:, own].T @ (target - fields[region][outline])
        weights[np.flatnonzero(touched)[own]] += fade[own, None] * pull
    return weights


def seam_jump(head: HeadLike, displacement: ArrayLike, within_mm: float = 16.0) -> Array:
    """How much more the displacement changes across the regions' borders than beside them, near the mouth corners.

    For each edge across a border: the length of the difference of its ends' displacements, less what the steepest of
    the edges around (within two steps, not across a border) would have over the same length. A step stays what it is
    on a finer mesh; a ramp, however steep, goes to zero.

    Parameters
    ----------
    head : HeadLike
    displacement : array_like, shape (F, V, 3), mm
    within_mm : float
        Surface distance from where the lips meet, in the head's unit.

    Returns
    -------
    ndarray, shape (F, E), mm
        Of each frame and each edge across a border; not positive where there is no jump.
    """
    skin = soft_mesh(head)
    u = np.asarray(displacement, dtype=np.float64)[:, skin.indices]
    seams = Seams(
        skin.vertices, edge_graph(skin.vertices, skin.triangles), {lip: skin.member(lip) for lip in LIPS}, within_mm
    )
    region = seams.member["upper lip"] + 2 * seams.member["lower lip"].astype(int)
    ends = edges(skin.triangles)
    distance = edge_distance(seams.graph, np.flatnonzero(seams.corners()), limit=within_mm)
    near = np.isfinite(distance[ends]).all(axis=1)
    across = region[ends[:, 0]] != region[ends[:, 1]]
    lengths = np.linalg.norm(skin.vertices[ends[:, 0]] - skin.vertices[ends[:, 1]], axis=1)
    change = np.linalg.norm(u[:, ends[:, 0]] - u[:, ends[:, 1]], axis=2)
    slope = np.where(across, 0.0, change / lengths)
    wanted = np.flatnonzero(near & across)
    jumps = np.empty((len(u), len(wanted)))
    for k, edge in enumerate(wanted):
        ring = np.zeros(len(skin.vertices), dtype=bool)
        ring[ends[edge]] = True
        around = seams.beside(ring)[ends].any(axis=1)
        jumps[:, k] = change[:, edge] - lengths[edge] * slope[:, around].max(axis=1)
    return jumps


def _closed_spline(points: Array, spacing: float) -> Array:
    """Values (K, B) of the closed uniform cubic B-splines along an outline, B about its length over the spacing.

    The points are put in order by their angle around the middle, in the plane in which they lie.
    """
    centred = points - points.mean(axis=0)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    # Stretched to a round outline: from the middle of a wide mouth, angles crowd at the corners.
    flat = centred @ axes[:2].T / np.maximum(spread[:2], 1e-12)
    order = np.argsort(np.arctan2(flat[:, 1], flat[:, 0]), kind="stable")
    # The knots start at the first point, whichever way the axes of the plane came out.
    order = np.roll(order, -int(np.argmin(order)))
    steps = np.linalg.norm(np.diff(points[order], axis=0, append=points[order[:1]]), axis=1)
    along = np.empty(len(points))
    along[order] = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    pieces = max(int(steps.sum() / spacing), 4)
    place = along / max(steps.sum(), 1e-12) * pieces
    knots = np.arange(-3.0, pieces + 4.0)
    open_basis = BSpline.design_matrix(np.minimum(place, np.nextafter(pieces, 0)), knots, 3).toarray()
    closed = open_basis[:, :pieces].copy()
    closed[:, :3] += open_basis[:, pieces:]
    return closed


seam_treatments: dict[str, Callable[[Mapping[str, Array], Seams], Array]] = {
    "none": one_field,
    "hard": hard,
    "ramp": ramp,
    "spline": spline,
}
"""Name to treatment; each takes the fields (V, n) of face, upper lip and lower lip to one map (V, n)."""
