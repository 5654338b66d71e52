"""The generic head, made from the tables of this folder alone: no vertex of any other mesh goes into it.

One sheet of rows and columns is laid over the face (:mod:`evalkit.head.cage`) and moved onto the signed
distance field of :mod:`evalkit.head.proportions`; rings go inward from the edges of lids and lips, and teeth,
eyeballs, ears and the plate with the hair are added (:mod:`evalkit.head.inside`). The left half is computed,
the right half mirrors it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.interpolate import PchipInterpolator
from scipy.sparse.linalg import spsolve

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import cage, inside, places
from evalkit.head import proportions as table
from evalkit.head.assembly import Assembly, grid_quads
from evalkit.head.model import REGIONS, Head, Indices, Jaw, Lids
from evalkit.head.surface import field, project
from evalkit.head.texture import paint, sheet_uv

DEFAULT_VERTICES = 11_000
SMALLEST, LARGEST = 1_000, 100_000

CAGES = {"upper": cage.UPPER, "middle": cage.MIDDLE, "lower": cage.LOWER}
"""Block of the sheet -> its rows of rays, from the top down."""

CORNER_WEIGHT = 0.42
"""Share of the jaw's angle at the corners of the mouth."""

HAIR_MM = 5.0
"""Thickness of the hair over the scalp."""

LID_MM = 1.1
"""The skin keeps this distance from the eyeballs, closed lids too."""

LID_GAP_MM = 0.15
"""Closed lids stop so far above the edges of the lower ones: they touch for the eye and never cross."""

CORNER_MM = 4.0
"""Around the inner corners of the eyes the sheet is evened out so far."""

SMOOTHING = 12
"""Rounds in which every free vertex of the sheet moves towards the middle of its neighbours, along the surface."""

WEIGHT_SMOOTHING = 16
"""Rounds of smoothing of the jaw's weights at the default resolution."""

MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Grid:
    """How finely the cage is divided, and the numbers of the sheet's vertices.

    Attributes
    ----------
    rows : dict of str to ndarray
        Per block, the cage row (a real number) of every grid row.
    half : ndarray
        The cage column of every grid column of the left half, 0 in the middle.
    ids : dict of str to ndarray of int, shape (rows, columns)
        Per block, vertex numbers; neighbouring blocks share those outside the openings.
    count : int
        Vertices of the sheet.
    """

    rows: dict[str, Array]
    half: Array
    ids: dict[str, Indices]
    count: int

    @property
    def across(self) -> Array:
        """Cage column of every column of the whole sheet, negative on the right side."""
        return np.concatenate([-self.half[:0:-1], self.half])

    def between(self, first: int, last: int) -> Indices:
        """Columns of the whole sheet from one cage column to another, both included."""
        return np.flatnonzero((self.across >= first - 1e-9) & (self.across <= last + 1e-9))

    @property
    def mouth(self) -> Indices:
        """Columns of the opening of the mouth, corners included."""
        return self.between(-cage.MOUTH_CORNER, cage.MOUTH_CORNER)

    @property
    def eyes(self) -> tuple[Indices, Indices]:
        """Columns of the openings of the left and the right eye, corners included."""
        return self.between(cage.INNER_EYE, cage.OUTER_EYE), self.between(-cage.OUTER_EYE, -cage.INNER_EYE)

    def loop(self, above: str, below: str, columns: Indices) -> tuple[Indices, Indices]:
        """Vertices of an opening's upper edge without its last corner, and of its lower edge back to the first."""
        upper, lower = self.ids[above][-1, columns], self.ids[below][0, columns]
        return upper[:-1], lower[:0:-1]


def make_grid(scale: float) -> Grid:
    """Divide every interval of the cage into about ``scale`` times its default number of steps."""
    half = _divided(cage.COLUMNS, scale)
    rows = {name: _divided(cage.ROWS[name], scale) for name in CAGES}
    width = 2 * len(half) - 1
    ids: dict[str, Indices] = {}
    count, above = 0, ""
    for name in CAGES:
        block = count + np.arange(len(rows[name]) * width).reshape(-1, width)
        if above:
            grid = Grid(rows, half, ids, 0)
            inner = np.zeros(width, dtype=bool)
            for columns in grid.eyes if name == "middle" else (grid.mouth,):
                inner[columns[1:-1]] = True
            # Only between the corners does the first row have vertices of its own.
            first = np.where(inner, count + np.cumsum(inner) - 1, ids[above][-1])
            block += inner.sum() - width
            block[0] = first
        ids[name], above = block, name
        count = int(block.max()) + 1
    return Grid(rows, half, ids, count)


def _divided(default: tuple[int, ...], scale: float) -> Array:
    """Cage coordinate of every grid line."""
    steps = [max(1, round(n * scale)) for n in default]
    return np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(steps))])


def make_template(vertices: int = DEFAULT_VERTICES) -> Head:
    """The built-in head.

    Parameters
    ----------
    vertices : int
        About so many, 1,000 to 100,000; rows and columns are whole numbers, so the count differs by some 15 %.

    Returns
    -------
    Head
        The same for the same number, whenever and wherever it is made.

    Raises
    ------
    EvalkitError
        If the number is out of range.
    """
    if not SMALLEST <= vertices <= LARGEST:
        raise EvalkitError(f"the template can have {SMALLEST:,} to {LARGEST:,} vertices, not {vertices:,}")
    scale = float(np.sqrt(vertices / DEFAULT_VERTICES))
    grid = make_grid(scale)
    skin = sheet(grid)
    jaw = jaw_weights(grid)
    turn, lift = lid_motion(grid, skin)
    build = Assembly()
    build.add(
        skin, sheet_uv(grid), region=sheet_regions(grid), jaw=jaw,
        eye=np.select([(turn != 0) & (skin[:, 0] > 0), (turn != 0)], [0, 1], -1), turn=turn, lift=lift,
    )  # fmt: skip
    for part, quads in sheet_faces(grid).items():
        build.faces(part, quads)
    for eye in (0, 1):
        inside.add_lid_rings(build, grid, eye)
    inside.add_pocket(build, grid, scale)
    inside.add_teeth(build, scale)
    inside.add_eyeballs(build, scale)
    inside.add_ears(build, scale)
    inside.add_plate(build)
    triangles, parts = build.triangles()
    region = build.column("region").astype(np.intp)
    place = build.column("place")
    outer = np.concatenate([triangles[slice(*parts[name])] for name in ("skin", "lids")])
    return Head(
        name="template",
        vertices=place,
        triangles=triangles,
        parts=parts,
        regions={name: np.flatnonzero(region == k) for k, name in enumerate(REGIONS)},
        landmarks=places.on_skin(places.all_landmarks(), place, outer),
        marker_sites=places.on_skin(places.all_marker_sites(), place, outer),
        jaw=Jaw(table.JAW_AXIS, build.column("jaw")),
        lids=Lids(
            np.stack([table.EYE_CENTRE, table.EYE_CENTRE * MIRROR]),
            table.EYE_RADIUS,
            build.column("eye").astype(np.intp),
            build.column("turn"),
            build.column("lift"),
        ),
        uv=build.column("uv"),
        texture=paint(),
        source="made by evalkit; proportions measured on ICT-FaceKit (MIT), see evalkit/head/proportions.py",
    )


# ---- the sheet -------------------------------------------------------------------------------------------------


def cast(rays: list[cage.Ray]) -> Array:
    """Where rays meet the surface, mm, shape (rays, 3)."""
    place = np.array([ray.origin for ray in rays])
    direction = np.array([ray.direction for ray in rays])
    for _ in range(60):
        # Short steps: the field of an ellipsoid is no true distance further away.
        place += 0.7 * field(place, table.PRIMITIVES)[:, None] * direction
    return place


def sheet(grid: Grid) -> Array:
    """Places of the sheet's vertices on the surface, shape (count, 3), mm."""
    out = np.full((grid.count, 3), np.nan)
    crossings = cast([ray for rows in CAGES.values() for row in rows for ray in row])
    for name, rows in CAGES.items():
        half, crossings = np.split(crossings, [len(rows) * len(rows[0])])
        half = half.reshape(len(rows), -1, 3)
        whole = np.concatenate([half[:, :0:-1] * MIRROR, half], axis=1)
        reach = half.shape[1] - 1
        wide = PchipInterpolator(np.arange(-reach, reach + 1), whole, axis=1)(grid.half)
        fine = PchipInterpolator(np.arange(len(half)), wide, axis=0)(grid.rows[name])
        out[grid.ids[name][:, len(grid.half) - 1 :]] = fine
        out[grid.ids[name][:, : len(grid.half)]] = fine[:, ::-1] * MIRROR
    left = np.unique(np.concatenate([block[:, len(grid.half) - 1 :].ravel() for block in grid.ids.values()]))
    mirrored = _mirror_map(grid)
    average, fixed = _smoother(grid)
    out[left] = project(out[left], table.PRIMITIVES)
    out[mirrored[left]] = out[left] * MIRROR
    for _ in range(SMOOTHING):
        moved = 0.5 * (out + average @ out)
        moved[fixed] = out[fixed]
        moved[left] = project(moved[left], table.PRIMITIVES, steps=1)
        moved[mirrored[left]] = moved[left] * MIRROR
        out = moved
    out[left] = project(out[left], table.PRIMITIVES, steps=3)
    middle = np.concatenate([block[:, len(grid.half) - 1] for block in grid.ids.values()])
    out[middle, 0] = 0.0
    out[left] = _eased_at_corners(grid, _clear_of_eye(out, left), average, fixed)[left]
    out[left] += _hair(grid, out)[left]
    out[mirrored[left]] = out[left] * MIRROR
    return out


def _mirror_map(grid: Grid) -> Indices:
    """The vertex of the sheet on the other side of each one."""
    out = np.arange(grid.count)
    for block in grid.ids.values():
        out[block] = block[:, ::-1]
    return out


def _smoother(grid: Grid) -> tuple[sparse.csr_array, Indices]:
    """The matrix that averages each vertex's neighbours, and the vertices that are to stay."""
    edges = sheet_edges(grid)
    graph = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(grid.count, grid.count)).tocsr()
    graph = graph + graph.T
    graph.data[:] = 1.0
    stay = np.zeros(grid.count, dtype=bool)
    for block in grid.ids.values():
        stay[block[:, [0, -1]]] = True
    stay[grid.ids["upper"][0]] = stay[grid.ids["lower"][-1]] = True
    for columns in grid.eyes:
        stay[grid.ids["upper"][-1, columns]] = stay[grid.ids["middle"][0, columns]] = True
    stay[grid.ids["middle"][-1, grid.mouth]] = stay[grid.ids["lower"][0, grid.mouth]] = True
    return sparse.diags_array(1.0 / graph.sum(axis=1)) @ graph, np.flatnonzero(stay)


def sheet_edges(grid: Grid) -> Indices:
    """Edges (N, 2) along rows and columns of the sheet, once each."""
    pairs = []
    for block in grid.ids.values():
        pairs += [np.stack([block[:, :-1], block[:, 1:]], -1).reshape(-1, 2)]
        pairs += [np.stack([block[:-1], block[1:]], -1).reshape(-1, 2)]
    return np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)


def _clear_of_eye(skin: Array, left: Indices) -> Array:
    """The sheet with vertices near the left eyeball pushed out to the thickness of a lid."""
    arm = skin[left] - table.EYE_CENTRE
    reach = np.maximum(np.linalg.norm(arm, axis=1), table.EYE_RADIUS + LID_MM)
    out = skin.copy()
    out[left] = table.EYE_CENTRE + arm * (reach / np.linalg.norm(arm, axis=1))[:, None]
    return out


def _eased_at_corners(grid: Grid, skin: Array, average: sparse.csr_array, fixed: Indices) -> Array:
    """The sheet with the hollow beside the inner corner of the eye evened out, where rows crowd together."""
    corner = skin[grid.ids["upper"][-1, grid.eyes[0][0]]]
    near = np.linalg.norm(skin - corner, axis=1) < CORNER_MM
    near[fixed] = False
    out = skin.copy()
    for _ in range(2):
        out[near] = 0.5 * (out + average @ out)[near]
    return out


def _hair(grid: Grid, skin: Array) -> Array:
    """Displacement of the scalp by the hair over it."""
    amount = np.zeros(grid.count)
    rows = grid.rows["upper"]
    amount[grid.ids["upper"]] = (HAIR_MM * _smoothstep((cage.HAIRLINE - rows) / 1.2))[:, None]
    middle = np.array([0.0, 55.0, cage.CUT_Z_MM])
    out = skin - middle
    return amount[:, None] * out / np.linalg.norm(out, axis=1)[:, None]


def _smoothstep(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def sheet_faces(grid: Grid) -> dict[str, Indices]:
    """Quadrilaterals of the skin and of the lids."""
    skin, lids = [], []
    for name, block in grid.ids.items():
        row = grid.rows[name][:-1]
        column = np.abs(grid.across[:-1] + grid.across[1:]) / 2
        eye = (column > cage.INNER_EYE) & (column < cage.OUTER_EYE)
        last = {"upper": row >= len(CAGES["upper"]) - 2 - 1e-9, "middle": row < 1 - 1e-9}.get(name, row < 0)
        lid = (last[:, None] & eye).ravel()
        quads = grid_quads(block)
        skin.append(quads[~lid])
        lids.append(quads[lid])
    return {"skin": np.concatenate(skin), "lids": np.concatenate(lids)}


def sheet_regions(grid: Grid) -> Indices:
    """Number of each vertex's region in :data:`evalkit.head.model.REGIONS`."""
    hindbrain, neck, face, upper_lip, lower_lip = range(5)
    out = np.full(grid.count, face)
    column = np.abs(grid.across)
    for name, block in grid.ids.items():
        row = grid.rows[name][:, None]
        kind = np.full(block.shape, face)
        if name == "upper":
            kind[np.broadcast_to(row < cage.HAIRLINE, block.shape)] = hindbrain
        if name == "middle":
            kind[(row > cage.UPPER_LIP_ROW) & (column < cage.LIP_COLUMN)] = upper_lip
        if name == "lower":
            kind[(row < cage.LOWER_LIP_ROW) & (column < cage.LIP_COLUMN)] = lower_lip
            kind[np.broadcast_to(row > cage.NECK_ROW, block.shape)] = neck
        rear = column > cage.REAR_COLUMN
        kind[(kind == face) & rear] = hindbrain
        # Later blocks must not overwrite the row that they share.
        new = np.ones(block.shape, dtype=bool)
        if name != "upper":
            new[0] = block[0] > ids_before(grid, name)
        out[block[new]] = kind[new]
    return out


def ids_before(grid: Grid, name: str) -> int:
    """The last vertex number of the block above."""
    names = list(CAGES)
    return int(grid.ids[names[names.index(name) - 1]].max())


# ---- motion ----------------------------------------------------------------------------------------------------


def jaw_weights(grid: Grid) -> Array:
    """Share of the jaw's angle of every vertex of the sheet.

    Prescribed on skull, chin, jaw line, neck and the edges of the lips; harmonic on the sheet in between, so
    that it is smooth and stays between 0 and 1.
    """
    known = np.full(grid.count, np.nan)
    column = np.abs(grid.across)
    upper, middle, lower = (grid.ids[name] for name in CAGES)
    rows = grid.rows
    known[upper] = 0.0
    known[middle[rows["middle"] <= 3]] = 0.0
    known[middle[np.ix_(rows["middle"] <= 5, column <= 2)]] = 0.0
    chin = np.ix_((rows["lower"] >= 2) & (rows["lower"] <= 4), column <= 3)
    known[lower[chin]] = 1.0
    known[lower[np.ix_((rows["lower"] >= 3) & (rows["lower"] <= 4), column <= 5)]] = 1.0
    known[lower[-1]] = 0.0
    for block in (middle, lower):
        known[block[:, column >= 8]] = 0.0
    off_middle = np.abs(grid.across[grid.mouth]) / cage.MOUTH_CORNER
    bend = off_middle**2.5
    known[lower[0, grid.mouth]] = 1.0 - (1.0 - CORNER_WEIGHT) * bend
    known[middle[-1, grid.mouth]] = CORNER_WEIGHT * bend
    edges = sheet_edges(grid)
    graph = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(grid.count, grid.count)).tocsr()
    graph = graph + graph.T
    laplacian = (sparse.diags_array(graph.sum(axis=1)) - graph).tocsr()
    free, held = np.flatnonzero(np.isnan(known)), np.flatnonzero(~np.isnan(known))
    known[free] = spsolve(laplacian[free][:, free].tocsc(), -laplacian[free][:, held] @ known[held])
    # Harmonic weights bend sharply where they are prescribed: even them out, the lips' edges excepted.
    lips = np.unique(np.concatenate([lower[0, grid.mouth], middle[-1, grid.mouth]]))
    average, _ = _smoother(grid)
    for _ in range(round(WEIGHT_SMOOTHING * len(grid.half) / (1 + sum(cage.COLUMNS)))):
        smooth = 0.5 * (known + average @ known)
        smooth[lips] = known[lips]
        known = smooth
    mirrored = _mirror_map(grid)
    return np.clip(0.5 * (known + known[mirrored]), 0.0, 1.0)


def lid_motion(grid: Grid, skin: Array) -> tuple[Array, Array]:
    """Angle and change of distance from the eyeball's middle when the lids are closed, of every sheet vertex."""
    turn, lift = np.zeros(grid.count), np.zeros(grid.count)
    upper, middle = grid.ids["upper"], grid.ids["middle"]
    # From the crease (0) to the edge (1).
    share = np.clip(grid.rows["upper"] - (len(CAGES["upper"]) - 2), 0.0, 1.0)
    rows = np.flatnonzero(share > 0)
    for eye, columns in enumerate(grid.eyes):
        centre = table.EYE_CENTRE * (MIRROR if eye else 1.0)
        columns = columns[1:-1]
        edge, below = skin[upper[-1, columns]] - centre, skin[middle[0, columns]] - centre
        angle = np.arctan2(edge[:, 1], edge[:, 2]) - np.arctan2(below[:, 1], below[:, 2])
        reach = np.linalg.norm(below, axis=1)
        angle = np.maximum(angle - LID_GAP_MM / reach, 0.0)
        ids = upper[np.ix_(rows, columns)]
        away = np.linalg.norm(skin[ids] - centre, axis=2)
        turn[ids] = share[rows][:, None] * angle
        goal = np.maximum(away + share[rows][:, None] * (reach - away[-1]), table.EYE_RADIUS + LID_MM)
        lift[ids] = goal - away
    return turn, lift
