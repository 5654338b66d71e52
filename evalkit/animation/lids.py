"""Eyelids: driven by their markers where these blink, else by blinks of their own, about one in four seconds."""

from __future__ import annotations

import numpy as np

from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.seeds import generator

LID_SITES = ("LidL", "LidR")

EVERY_S = 4.0
"""Mean time from blink to blink; Huang et al. 2000, section 3.2."""

REGULARITY = 6.0
"""Shape of the gamma distribution of that time: spread 1.6 s about the mean of 4 s, rarely below one second."""

SHORTEST_S = 0.8
"""Blinks do not overlap."""

PHASES_S = (0.08, 0.05, 0.19)
"""Closing, closed, opening."""

BLINKING = 0.45
"""A lid marker blinks if it comes down at some time by this part of the way that the head's own lid goes. Markers
above the crease of the lid never do."""


def blink_times(duration_s: float, seed: int = 0) -> Array:
    """Starts of blinks within a duration, s."""
    random = generator("blinks", seed=seed)
    count = int(2 * duration_s / EVERY_S) + 16
    # What the shortest time takes away at one end is given back by the rest: the mean stays.
    gaps = SHORTEST_S + random.gamma(REGULARITY, (EVERY_S - SHORTEST_S) / REGULARITY, count)
    starts = np.cumsum(gaps) - gaps[0] * random.uniform()
    return np.asarray(starts[starts < duration_s])


def blink_track(times_s: Array, starts_s: Array) -> Array:
    """How far the lids are closed at each time, 0 to 1, shape (F,)."""
    if not len(starts_s):
        return np.zeros(len(times_s))
    last = np.searchsorted(starts_s, times_s, side="right") - 1
    since = np.where(last >= 0, times_s - starts_s[last], np.inf)
    closing, closed, opening = PHASES_S
    down = np.clip(since / closing, 0.0, 1.0)
    up = np.clip((since - closing - closed) / opening, 0.0, 1.0)
    return np.asarray(_smooth(down) - _smooth(up))


def lid_travel(head: Head) -> dict[str, float]:
    """How far down a head's own lids carry their marker sites, mm; empty for a head whose lids stay."""
    if head.lids is None:
        return {}
    at = head.nearest_vertices({name: head.marker_sites[name] for name in LID_SITES if name in head.marker_sites})
    closed = head.posed(lids_closed=1.0)
    drops = {name: float(head.vertices[vertex, 1] - closed[vertex, 1]) for name, vertex in at.items()}
    return {name: drop for name, drop in drops.items() if drop > 1.0}


def driven_lids(head: Head, displacement: dict[str, Array]) -> dict[str, Array]:
    """Lid site -> how far it is closed (F,), for the lid markers that blink.

    Parameters
    ----------
    head : Head
    displacement : dict of str to ndarray, shape (F, 3), mm
        Of marker sites, in the head's axes and size.
    """
    found = {}
    for name, travel in lid_travel(head).items():
        if name in displacement:
            closed = -displacement[name][:, 1] / travel
            # The 99.5th percentile: some frames of every blink, and not one frame's outlier.
            if np.percentile(closed, 99.5) - np.median(closed) >= BLINKING:
                found[name] = np.clip(closed, 0.0, 1.0)
    return found


def close_lids(head: Head, vertices: Array, closed: Array) -> None:
    """Lower the lids of vertices (F, V, 3) in place, by (F, 2) for the left and the right eye.

    The lids slide over the eyeballs as in :meth:`evalkit.head.Head.posed`, from wherever the markers have moved
    them; they never come nearer to the middle of the eyeball than at rest.
    """
    lids = head.lids
    if lids is None:
        return
    which = np.flatnonzero(lids.eye >= 0)
    eye = lids.eye[which]
    centre = lids.centres[eye]
    arm = vertices[:, which] - centre
    reach = np.linalg.norm(arm, axis=2)
    at_rest = np.linalg.norm(head.vertices[which] - centre, axis=1)
    amount = closed[:, eye]
    angle = amount * lids.turn[which]
    y, z = arm[:, :, 1], arm[:, :, 2]
    turned = np.stack([arm[:, :, 0], np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z], -1)
    length = np.maximum(reach, at_rest) + amount * lids.lift[which]
    vertices[:, which] = centre + turned * (length / reach)[:, :, None]


def _smooth(x: Array) -> Array:
    return x * x * (3.0 - 2.0 * x)
