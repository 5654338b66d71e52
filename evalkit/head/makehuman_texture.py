"""The procedural texture of MakeHuman's head: hair, brows, lips, lashes, mouth and eyes.

Its own texture coordinates are cut along seams, where every vertex would have to be there twice; here each vertex
has one place in the picture (:func:`sheet_uv`), and a colour follows from the place on the head at rest that a
pixel belongs to. Eyes and teeth share the tiles of the template's picture (:mod:`evalkit.head.texture`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.head import texture
from evalkit.head.model import Indices
from evalkit.head.texture import BLUSH, HAIR, LIP, MOUTH, SIZE, SKIN, Array, blob, mix, ramp
from evalkit.seeds import generator

MASKS = ("lips", "inside-mouth", "ears")
"""What the skin is told apart by, named as MakeHuman's masks."""

LOWEST_V = 0.25
"""The skin takes the picture above this height, the tiles of eyes, teeth and tongue what is below."""

EVENING = 0.45
"""Exponent on the distance from the middle of the disc: the neck around it would take nearly all of the picture."""

HAIRLINE = (
    # degrees around the vertical axis from the front, height in mm
    (0.0, 107.0), (28.0, 106.0), (44.0, 96.0), (56.0, 76.0), (64.0, 48.0), (72.0, 24.0), (84.0, 16.0), (100.0, 8.0),
    (116.0, -24.0), (150.0, -46.0), (180.0, -50.0),
)  # fmt: skip
"""By eye."""

WAVES = 24
"""Plane waves that noise is made of."""

TONGUE = np.array([196.0, 96.0, 98.0])
TONGUE_UV = (0.375, 0.19)
"""In the tile that the template has for its ears, which are skin here."""

TOOTH_UV = texture.teeth_uv(np.array(0.0625), np.array(0.5))
"""In the middle of a tooth: no vertex of the mesh says where one ends."""


def sheet_uv(triangles: Indices, vertices: Array) -> Array:
    """One place in the picture for every vertex of the skin, shape (V, 2); no two triangles overlap.

    The skin with the mouth's inside is a disc whose border is the cut through the neck. The border goes to a circle
    and every other vertex to the mean of its neighbours, weighted by the lengths of the edges to them, which makes a
    planar drawing [1]_ with most room where the mesh is fine: at eyes and lips.

    Parameters
    ----------
    triangles : ndarray of int, shape (T, 3)
        Of a disc.
    vertices : ndarray, shape (V, 3), mm
        Those of no triangle get (0, 0).

    References
    ----------
    .. [1] W. T. Tutte, "How to Draw a Graph", Proc. London Math. Soc. 13, 1963, doi:10.1112/plms/s3-13.1.743.
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu

    used, local = np.unique(triangles, return_inverse=True)
    local = local.reshape(-1, 3)
    directed = np.concatenate([local[:, [0, 1]], local[:, [1, 2]], local[:, [2, 0]]])
    graph = sparse.coo_array((np.ones(len(directed)), directed.T), shape=(len(used), len(used))).tocsr()
    # An edge of the border is passed in one direction only.
    border = (graph - graph.multiply(graph.T)).tocoo()
    ahead = dict(zip(border.coords[0][border.data > 0], border.coords[1][border.data > 0], strict=True))
    loop = [next(iter(ahead))]
    while ahead[loop[-1]] != loop[0]:
        loop.append(ahead[loop[-1]])
    around = 2.0 * np.pi * np.arange(len(loop)) / len(loop)
    flat = np.zeros((len(used), 2))
    flat[loop] = np.stack([np.cos(around), np.sin(around)], axis=1)
    graph = (graph + graph.T).tocoo()
    start, end = graph.coords
    length = np.linalg.norm(vertices[used[start]] - vertices[used[end]], axis=1)
    graph = sparse.coo_array((length, graph.coords), shape=graph.shape).tocsr()
    free = np.setdiff1d(np.arange(len(used)), loop)
    laplacian = (sparse.diags_array(graph.sum(axis=1)) - graph).tocsr()
    flat[free] = splu(laplacian[free][:, free].tocsc()).solve(graph[free][:, loop] @ flat[loop])
    flat *= np.linalg.norm(flat, axis=1, keepdims=True) ** (EVENING - 1.0)
    out = np.zeros((len(vertices), 2))
    out[used] = [0.5, 0.5 * (1.0 + LOWEST_V)] + 0.99 * flat * [0.5, 0.5 * (1.0 - LOWEST_V)]
    return out


def eyeball_uv(vertices: Array) -> Array:
    """Texture coordinates of one eyeball's vertices (N, 3): seen from the front, so that the iris is round."""
    arm = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    arm /= np.linalg.norm(arm, axis=1, keepdims=True)
    return texture.eye_uv(np.arccos(np.clip(arm[:, 2], -1.0, 1.0)), np.arctan2(arm[:, 1], arm[:, 0]))


def paint(
    skin: Indices, uv: Array, vertices: Array, masks: dict[str, Array], landmarks: dict[str, Array], eyes: Array
) -> NDArray[np.uint8]:
    """The picture.

    Parameters
    ----------
    skin : ndarray of int
        Vertices of the skin.
    uv, vertices : ndarray, shape (V, 2) and (V, 3), mm
    masks : dict of str to ndarray, shape (V,)
        Name out of :data:`MASKS` -> share to which a vertex belongs to it.
    landmarks : dict of str to ndarray, shape (3,), mm
    eyes : ndarray, shape (4,), mm
        Middle and radius of the left eyeball.

    Returns
    -------
    ndarray of uint8, shape (SIZE, SIZE, 4)
    """
    from scipy.interpolate import LinearNDInterpolator

    picture = texture.paint().astype(np.float32)
    rows = round((1.0 - LOWEST_V) * SIZE)
    u = (np.arange(SIZE) + 0.5) / SIZE
    values = np.column_stack([vertices[skin], *(masks[name][skin] for name in MASKS)])
    # Beyond the rim nothing is seen.
    found = LinearNDInterpolator(uv[skin], values, fill_value=0.0)(*np.meshgrid(u, 1.0 - u[:rows]))
    place, share = found[..., :3].astype(np.float32), dict(zip(MASKS, np.moveaxis(found[..., 3:], -1, 0), strict=True))
    _paint_skin(picture[:rows], place, share, landmarks, eyes)
    tile = texture.tile_slices(u, 1.0 - u, (0.251, 0.499, 0.13, 0.25))
    picture[tile][..., :3] = TONGUE
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _mottle(place: Array, wave_mm: float, name: str) -> Array:
    """Smooth noise of unit standard deviation over places on the head, mirror-symmetric."""
    drawn = generator("MakeHuman texture", name, seed=0)
    out = np.zeros(place.shape[:-1], dtype=np.float32)
    mirrored = np.abs(place[..., :1])
    place = np.concatenate([mirrored, place[..., 1:]], axis=-1)
    for wave in (2.0 * np.pi / wave_mm * drawn.standard_normal((WAVES, 3))).astype(np.float32):
        out += np.sin(place @ wave + np.float32(drawn.uniform(0.0, 2.0 * np.pi)))
    return np.sqrt(np.float32(2.0 / WAVES)) * out


def _paint_skin(face: Array, place: Array, share: dict[str, Array], landmarks: dict[str, Array], eyes: Array) -> None:
    x, y, z = np.abs(place[..., 0]), place[..., 1], place[..., 2]
    front = ramp(z, 40.0, 60.0)
    face[..., :3] = SKIN + (4.0 * _mottle(place, 40.0, "blotches"))[..., None] * np.array([0.6, 1.0, 1.0])
    face[..., :3] += (2.0 * _mottle(place, 4.0, "pores"))[..., None]
    face[..., 3] = 255.0
    nose, mouth = landmarks["nose tip"], landmarks["mouth corner left"]
    mix(face, BLUSH, 0.30 * front * blob(x, y, 1.6 * mouth[0], nose[1], 15.0, 14.0))
    mix(face, BLUSH, 0.25 * front * blob(x, y, 0.0, nose[1], 13.0, 10.0))
    mix(face, BLUSH, 0.25 * ramp(share["ears"], 0.2, 0.8))
    # The sockets, and the lashes along the edges of the lids.
    mix(face, SKIN * [0.74, 0.66, 0.64], 0.40 * front * blob(x, y, eyes[0], eyes[1] + 7.0, 17.0, 7.0))
    off = np.linalg.norm(np.stack([x, y, z], axis=-1) - eyes[:3], axis=-1) - eyes[3]
    edge = (1.0 - ramp(off, 0.6, 2.2)) * ramp(z - eyes[2], 3.0, 6.0)
    mix(face, HAIR * 0.6, edge * np.where(y > eyes[1] - 1.0, 0.9, 0.4))
    # Brows: an arch between their ends, highest at two thirds.
    inner, outer = landmarks["brow inner left"], landmarks["brow outer left"]
    along = (x - inner[0] + 3.0) / (outer[0] - inner[0] + 3.0)
    arch = inner[1] - 4.0 + (outer[1] - inner[1] + 2.0) * along + 36.0 * np.clip(along, 0.0, 1.0) ** 2 * (1.0 - along)
    half = 3.2 * (1.0 - 0.7 * ramp(along, 0.4, 1.0)) * (0.6 + 0.4 * ramp(along, 0.0, 0.25))
    brow = ramp(half - np.abs(y - arch), -1.4, 1.8) * ramp(along, -0.05, 0.2) * (1.0 - ramp(along, 0.88, 1.02))
    mix(face, HAIR * 1.2, np.clip(brow * front * (0.82 + 0.12 * _mottle(place, 2.5, "brow")), 0.0, 1.0))
    # The mask leaves out the very corners.
    lips = np.maximum(ramp(share["lips"], 0.25, 0.75), blob(x, y, mouth[0], mouth[1], 1.5, 1.5) * front)
    mix(face, LIP, 0.65 * lips)
    mix(face, MOUTH * 1.3, ramp(share["inside-mouth"], 0.3, 0.9))
    line = np.interp(np.degrees(np.arctan2(x, z)), *np.array(HAIRLINE).T)
    hair = ramp(y - line + 1.2 * _mottle(place, 9.0, "hairline"), -4.0, 5.0) * (1.0 - ramp(share["ears"], 0.1, 0.5))
    # The mouth's roof lies behind the face, too.
    hair = hair * (1.0 - share["inside-mouth"])
    strands = HAIR * (1.0 + 0.12 * _mottle(place, 7.0, "strands")[..., None])
    face[..., :3] += hair[..., None] * (strands - face[..., :3])
