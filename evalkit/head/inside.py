"""What is seen through the openings of the sheet and around it: lid edges, mouth, teeth, eyeballs, ears, plate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from evalkit.head import cage, texture
from evalkit.head import proportions as table
from evalkit.head.assembly import Assembly, grid_quads, ring_quads
from evalkit.head.model import REGIONS, Indices

if TYPE_CHECKING:
    from evalkit.head.template import Grid

MIRROR = np.array([-1.0, 1.0, 1.0])

FACE, UPPER_LIP, LOWER_LIP = (REGIONS.index(name) for name in ("face", "upper lip", "lower lip"))


def add_lid_rings(build: Assembly, grid: Grid, eye: int) -> None:
    """Edges of the lids: from the sheet inward to the eyeball, and on inside it so that no gap can show.

    The last ring lies within the eyeball all around the opening, at the corners too: whatever ray enters
    between the lids meets the edge or the ball.
    """
    centre = table.EYE_CENTRE * (MIRROR if eye else 1.0)
    upper, lower = grid.loop("upper", "middle", grid.eyes[eye])
    outer = np.concatenate([upper, lower])
    place, turn = build.column("place")[outer], build.column("turn")[outer]
    uv = build.column("uv")[outer]
    arm = place - centre
    direction = arm / np.linalg.norm(arm, axis=1)[:, None]
    axis = direction.mean(axis=0)
    axis /= np.linalg.norm(axis)
    moves = turn != 0
    ring = outer
    middle_uv = uv.mean(axis=0)
    # (distance from the middle of the ball, how far the ring is widened away from the opening's middle)
    for k, (radius, widen) in enumerate(((table.EYE_RADIUS + 0.35, 0.0), (table.EYE_RADIUS - 0.7, 0.10))):
        off = direction - (direction @ axis)[:, None] * axis
        wide = direction + widen * off / np.linalg.norm(off, axis=1)[:, None]
        wide /= np.linalg.norm(wide, axis=1)[:, None]
        new = build.add(
            centre + radius * wide,
            uv + (0.3 + 0.3 * k) * (middle_uv - uv) * [0.1, 1.0],
            region=FACE,
            eye=np.where(moves, eye, -1),
            turn=turn,
        )
        build.faces("lids", ring_quads(ring, new))
        ring = new


POCKET = (
    # height above and below the line between the lips, half width, z in the middle, z at the sides
    (0.0, 0.0, 25.0, -2.5, -1.0),
    (11.0, 12.5, 24.5, 104.8, 95.5),
    (16.0, 17.0, 30.0, 98.0, 82.0),
    (16.0, 17.0, 33.0, 76.0, 66.0),
    (0.0, 0.0, 26.0, 46.0, 46.0),
)
"""Rings of the mouth from the lips inward, mm. The first one's z are relative to the edges of the lips: it gives the
lips their thickness; the last one closes the mouth at the back."""

BACK_WEIGHT = 0.45
"""Share of the jaw's angle at the back of the mouth."""

POCKET_STEPS = (2, 4, 2, 4, 4)
"""Steps up to each ring at the default resolution."""


def add_pocket(build: Assembly, grid: Grid, scale: float) -> None:
    """The mouth: from the edges of the lips inward, closed at the back."""
    upper, lower = grid.loop("middle", "lower", grid.mouth)
    outer = np.concatenate([upper, lower])
    place, uv, weight = (build.column(name)[outer] for name in ("place", "uv", "jaw"))
    is_upper = np.arange(len(outer)) < len(upper)
    # The vertex of the other lip in the same column; a corner is its own.
    partner = -np.arange(len(outer)) % len(outer)
    corner = np.zeros(len(outer), dtype=bool)
    corner[[0, len(upper)]] = True
    sideways = np.clip(place[:, 0] / np.abs(place[:, 0]).max(), -1.0, 1.0)
    along = np.arcsin(sideways)
    # Down the lower half of the ring the sign of the height changes; at the corners there is none.
    sign = np.where(corner, 0.0, np.where(is_upper, 1.0, -1.0))
    level = place[corner, 1].mean()
    rings = [place]
    for k, (above, below, half, z_middle, z_side) in enumerate(POCKET):
        height = np.where(is_upper, above, below) * sign * np.cos(along)
        if k == 0:
            # Both lips roll inward to one line between them: closed lips let nothing of the teeth be seen.
            level_here = 0.5 * (place[:, 1] + place[partner, 1])
            depth = z_side + (z_middle - z_side) * np.cos(along)
            rings.append(np.stack([0.98 * place[:, 0], level_here + height, place[:, 2] + depth], axis=1))
            continue
        z = z_side + (z_middle - z_side) * np.cos(along)
        rings.append(np.stack([half * sideways, level + height, z], axis=1))
    # The mouth's lining follows the lip before it; its back is half-way between the jaws.
    weights = [weight] * len(POCKET) + [np.full(len(outer), BACK_WEIGHT)]
    steps = [max(1, round(n * scale)) for n in POCKET_STEPS]
    knots = np.concatenate([[0], np.cumsum(steps)])
    fine = PchipInterpolator(knots, np.stack(rings))(np.arange(1, knots[-1] + 1))
    share = PchipInterpolator(knots, np.stack(weights))(np.arange(1, knots[-1] + 1))
    inward = np.arange(1, knots[-1] + 1) / knots[-1]
    middle_uv = uv.mean(axis=0)
    region = np.where(is_upper, UPPER_LIP, LOWER_LIP)
    ring = outer
    for k in range(knots[-1] - 1):
        new = build.add(fine[k], uv + inward[k] * (middle_uv - uv) * [0.2, 1.0], region=region, jaw=share[k])
        build.faces("mouth pocket", ring_quads(ring, new))
        ring = new
    # The last ring is a line: its lower half is the upper half, so that the mouth is closed.
    line = np.concatenate([fine[-1][is_upper], fine[-1][len(upper)][None]])
    ids = build.add(line, middle_uv, region=UPPER_LIP, jaw=BACK_WEIGHT)
    build.faces("mouth pocket", _closing(ring, np.concatenate([ids[:-1], ids[:0:-1]]), corner))


def _closing(outer: Indices, line: Indices, corner: NDArray[np.bool_]) -> Indices:
    """Faces from the last ring to the line that closes the mouth, cut so that no diagonal leaves a corner.

    Upper and lower half meet in the same line: a diagonal from a corner would be an edge of both.
    """
    a, b, inner_a, inner_b = outer, np.roll(outer, -1), line, np.roll(line, -1)
    from_corner = corner[:, None]
    first = np.where(from_corner, np.stack([b, a, inner_a, inner_a], -1), np.stack([b, a, inner_b, inner_b], -1))
    second = np.where(
        from_corner, np.stack([b, inner_a, inner_b, inner_b], -1), np.stack([a, inner_a, inner_b, inner_b], -1)
    )
    return np.concatenate([first, second])


def add_teeth(build: Assembly, scale: float) -> None:
    """Two horseshoes of rectangle patches; what is not tooth is transparent in the texture."""
    per_tooth = max(1, round(2 * scale))
    for part, arch, (gum, edge), jaw in (
        ("upper teeth", table.UPPER_TEETH, table.UPPER_TEETH_Y, 0.0),
        ("lower teeth", table.LOWER_TEETH, table.LOWER_TEETH_Y, 1.0),
    ):
        half = np.array(arch)
        whole = np.concatenate([half[:0:-1] * [-1.0, 1.0], half])
        reach = len(half) - 1
        at = np.linspace(-reach, reach, 2 * reach * per_tooth + 1)
        curve = PchipInterpolator(np.arange(-reach, reach + 1), whole)(at)
        top, bottom = max(gum, edge), min(gum, edge)
        rows = np.linspace(top, bottom, per_tooth + 1)
        place = np.stack(
            [
                np.broadcast_to(curve[:, 0], (len(rows), len(at))),
                np.broadcast_to(rows[:, None], (len(rows), len(at))),
                np.broadcast_to(curve[:, 1], (len(rows), len(at))),
            ],
            axis=-1,
        )
        place[..., 0] = 0.5 * (place[..., 0] - place[:, ::-1, 0])
        down = np.linspace(0.0, 1.0, len(rows))[:, None] if edge < gum else np.linspace(1.0, 0.0, len(rows))[:, None]
        build.faces(part, grid_quads(build.add(place, texture.teeth_uv(at / reach, down), jaw=jaw)))


def add_eyeballs(build: Assembly, scale: float) -> None:
    """Balls with the iris in front."""
    rings, segments = max(6, round(14 * scale)), max(8, 2 * round(12 * scale))
    # Closer rings in front, where the iris is.
    polar = np.pi * np.linspace(0.0, 1.0, rings + 1)[1:-1] ** 1.3
    around = 2.0 * np.pi * np.arange(segments) / segments
    for eye in (0, 1):
        centre = table.EYE_CENTRE * (MIRROR if eye else 1.0)
        # The right eye is the mirror image: its segments run the other way round.
        turn = np.pi - around if eye else around
        ring = np.stack(
            [
                np.sin(polar)[:, None] * np.cos(turn),
                np.sin(polar)[:, None] * np.sin(turn),
                np.broadcast_to(np.cos(polar)[:, None], (len(polar), segments)),
            ],
            axis=-1,
        )
        ids = build.add(centre + table.EYE_RADIUS * ring, texture.eye_uv(polar[:, None], turn))
        front = build.add(centre[None] + [[0.0, 0.0, table.EYE_RADIUS]], texture.eye_uv(np.zeros(1), np.zeros(1)))[0]
        rear = build.add(centre[None] - [[0.0, 0.0, table.EYE_RADIUS]], texture.eye_uv(np.full(1, np.pi), np.zeros(1)))[
            0
        ]
        closed = np.concatenate([ids, ids[:, :1]], axis=1)
        quads = np.concatenate(
            [
                np.stack([np.full(segments, front), closed[0, :-1], closed[0, 1:], np.full(segments, front)], -1),
                grid_quads(closed),
                np.stack([closed[-1, :-1], np.full(segments, rear), np.full(segments, rear), closed[-1, 1:]], -1),
            ]
        )
        build.faces("eyeballs", quads[:, ::-1] if eye else quads)


EAR_RINGS = (
    # share of the outline's radius, mm off the ear's plane, mm by which the ring lies forward and below of the middle
    (0.0, -5.0, 4.5, 3.5), (0.16, -4.6, 4.4, 3.4), (0.30, -2.8, 4.0, 3.0), (0.42, 1.6, 3.4, 2.4), (0.52, 3.6, 2.6, 1.6),
    (0.66, 3.0, 1.4, 0.6), (0.78, 1.8, 0.6, 0.2), (0.86, 3.0, 0.2, 0.0), (0.93, 5.2, 0.0, 0.0), (1.0, 4.6, 0.0, 0.0),
    (1.0, 2.4, 0.0, 0.0), (0.92, 0.0, 0.0, 0.0), (0.66, -5.0, 0.0, 0.0), (0.45, -14.0, 0.0, 0.0),
)  # fmt: skip
"""From the bowl over the inner and the outer fold to the rim, and back to the head behind it."""

EAR_MIDDLE = np.array([77.5, 8.5, -3.5])
EAR_HALF_MM = (28.0, 18.0)
"""Left ear: its middle, half height and half depth; from the extent of the skin of ICT-FaceKit's neutral face
beyond x = 76 mm (y from -19 to 36, z from -20 to 11, x up to 92 mm)."""

EAR_FLARE_DEG, EAR_TILT_DEG = 28.0, 10.0


def add_ears(build: Assembly, scale: float) -> None:
    """Ears as shells of their own that stick in the sides of the head."""
    segments = max(10, 2 * round(16 * scale))
    around = 2.0 * np.pi * np.arange(segments) / segments
    flare, tilt = np.deg2rad(EAR_FLARE_DEG), np.deg2rad(EAR_TILT_DEG)
    back = np.array([np.sin(flare), 0.0, -np.cos(flare)])
    up = np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    up -= back * (up @ back)
    up /= np.linalg.norm(up)
    out = np.cross(up, -back)
    height, depth = np.sin(around), np.cos(around)
    # The lobe is narrower than the top.
    outline = np.stack([EAR_HALF_MM[0] * height, EAR_HALF_MM[1] * depth * (0.86 + 0.16 * height)], axis=1)
    share, off, forward, below = (np.array(column) for column in zip(*EAR_RINGS, strict=True))
    # The folds are rolled above and behind, flat at the lobe and where the ear grows out of the cheek.
    roll = np.clip(0.5 + 0.45 * height + 0.5 * depth, 0.0, 1.0)
    relief = off[:, None] * np.where(off[:, None] > 0, 0.15 + 0.85 * roll, 1.0)
    # In front the ear grows out of the cheek: its rim sinks in there.
    relief -= 5.0 * share[:, None] ** 3 * np.clip(-depth - 0.35, 0.0, None)
    flat = share[:, None, None] * outline - np.stack([below, forward], axis=1)[:, None]
    place = EAR_MIDDLE + flat[..., :1] * up + flat[..., 1:] * back + relief[..., None] * out
    shade = texture.ear_uv(np.arange(len(share)) / (len(share) - 1))
    for mirrored in (False, True):
        points = place * MIRROR if mirrored else place
        middle = build.add(points[0, :1], shade[:1])[0]
        ids = build.add(points[1:], shade[1:, None, :])
        closed = np.concatenate([ids, ids[:, :1]], axis=1)
        fan = np.stack([np.full(segments, middle), closed[0, :-1], closed[0, 1:], np.full(segments, middle)], -1)
        quads = np.concatenate([fan, grid_quads(closed)])
        build.faces("ears", quads if mirrored else quads[:, ::-1])


PLATE_MM = (-110.0, 110.0, -150.0, 165.0)
"""Left, right, lower and upper end of the plate behind the mask."""


def add_plate(build: Assembly) -> None:
    """The plate behind the mask: it carries the hair and whatever of a photo the mask does not cover."""
    left, right, low, high = PLATE_MM
    x, y = np.linspace(left, right, 5), np.linspace(high, low, 7)
    place = np.stack([*np.meshgrid(x, y), np.full((7, 5), cage.CUT_Z_MM - 0.5)], axis=-1)
    build.faces(
        "plate",
        grid_quads(build.add(place, texture.plate_uv((place[..., :2] - [left, low]) / [right - left, high - low]))),
    )
