"""A take played on a head: from markers to vertices of every frame.

One way through: head motion out, label to marker site, rest, alignment, displacement, gaps, scale, deformation
map, and what no marker drives (lids, jaw, head motion back on).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evalkit.animation.alignment import Alignment, align, match_positions, place_others
from evalkit.animation.gaps import MODES, Filled, fill_gaps, fill_rotations, spikes
from evalkit.animation.head_motion import (
    LIMIT_DEG,
    beyond_limit,
    idle_motion,
    resample_rotations,
    within_picture,
)
from evalkit.animation.jaw import follow_jaw, jaw_followers, jaw_motion
from evalkit.animation.labels import BY_POSITION, match_labels
from evalkit.animation.lids import LID_SITES, blink_times, blink_track, close_lids, driven_lids
from evalkit.animation.lips import find_lips, overlap, part_lips
from evalkit.animation.rest import rest_pose
from evalkit.capture import Capture
from evalkit.capture.origin import screen_axes
from evalkit.compensation import compensate
from evalkit.deform import Deformation, Deformer
from evalkit.deform.map import deformation_report
from evalkit.deform.scaling import LOWER_FACE, MEASURES, Ratio, performer_scaling
from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import Array
from evalkit.head import Head

FEWEST_MARKERS = 4

LEAST_SEEN = 0.1
"""A marker seen in a smaller part of the frames drives nothing: most of what it did would be invented."""

MIRROR = np.array([-1.0, 1.0, 1.0])
MIRRORED = 0.7
"""A mirrored face that fits so much better is one: a face as it is fits better than its mirror image by its depth."""

HEAD_MOTION = ("take", "still", "idle")
"""The performer's own put back on, none, or small motions that a still head needs to look alive."""

UNMAPPED = ("place", "ignore")


@dataclass(frozen=True, eq=False)
class Animation:
    """A head and what it does in every frame that is shown.

    Attributes
    ----------
    head : Head
    rate_hz : float
        Frames shown per second.
    source_frames : ndarray, shape (F,)
        Frame of the take that is shown, fractional where the rate is another one.
    deformation : Deformation
        The map from its `labels` to vertices.
    displacements : ndarray, shape (F, n, 3), mm
        Of the map's centres, in the head's axes and size; nothing missing.
    lids_closed : ndarray, shape (F, 2)
        Left and right eye, 0 open to 1 closed.
    jaw_deg, jaw_glide_mm : ndarray, shapes (F,) and (F, 3)
        What lower teeth and tongue follow.
    rotations, translations : ndarray, shapes (F, 3, 3) and (F, 3), mm
        Head motion ``x = R p + T`` of every vertex p.
    raw_markers, still_markers : ndarray, shape (F, m, 3), mm
        The performer's markers before and after the head motion was taken out, in the head's axes about their
        middle at rest, NaN where missing. For pictures beside the head.
    pivot : ndarray, shape (3,), mm, or None
        Where the performer's head turns, in the axes of `still_markers`; None where no head motion was taken out.
    placed : dict of str to ndarray, shape (3,), mm
        Places on the head of the markers that have no site.
    held : ndarray of bool, shape (F,)
        A marker in a long gap, or the head pose, is not known here but held or bridged.
    report : dict
        How it was made, ready for JSON.
    """

    head: Head
    rate_hz: float
    source_frames: Array
    deformation: Deformation
    displacements: Array
    lids_closed: Array
    jaw_deg: Array
    jaw_glide_mm: Array
    rotations: Array
    translations: Array
    raw_markers: Array
    still_markers: Array
    pivot: Array | None
    placed: dict[str, Array]
    held: np.ndarray
    report: dict[str, Any]

    @property
    def frames(self) -> int:
        """Number of frames shown."""
        return len(self.displacements)

    @property
    def notes(self) -> list[str]:
        """What a user should know, one line each."""
        return list(self.report["notes"])

    def batches(self, frames: Sequence[int] | None = None) -> Iterator[tuple[int, Array]]:
        """First index and vertices (f, V, 3), mm, of one batch of frames after the other, without head motion.

        Every batch is written over the one before; copy what is to be kept.

        Parameters
        ----------
        frames : sequence of int, optional
            Which, in this order; all of them if not given.
        """
        which = np.arange(self.frames) if frames is None else np.asarray(frames, dtype=np.intp)
        head, lips = self.head, find_lips(self.head)
        deformer = Deformer(self.deformation.weights, head.vertices, np.float32)
        follow, share = jaw_followers(head)
        touching = None if lips is None else overlap(lips, head.vertices[None])[0]
        for start, vertices in deformer.batches(self.displacements[which]):
            at = which[start : start + len(vertices)]
            if len(follow):
                assert head.jaw is not None
                vertices[:, follow] = follow_jaw(
                    head.vertices[follow], share, head.jaw.axis, self.jaw_deg[at], self.jaw_glide_mm[at]
                )
            close_lids(head, vertices, self.lids_closed[at])
            if lips is not None and touching is not None:
                part_lips(lips, vertices, touching)
            yield start, vertices

    def vertices(self, frames: Sequence[int] | None = None) -> Array:
        """Vertices (f, V, 3), mm, of some or all frames at once, without head motion."""
        return np.concatenate([part.copy() for _, part in self.batches(frames)])


def animate(
    take: Capture,
    head: Head,
    *,
    compensated: bool = False,
    rigid: str | Sequence[str] = "auto",
    label_map: str | Mapping[str, str] | None = None,
    unmapped: str = "place",
    neutral: str | int = "auto",
    gaps: str = "hold",
    head_motion: str = "take",
    fps: float | None = None,
    kernel: str = "exponential",
    seam: str = "ramp",
    seed: int = 0,
) -> Animation:
    """Play a take on a head.

    Parameters
    ----------
    take : Capture
    head : Head
    compensated : bool
        The take has no head motion left; otherwise it is taken out here.
    rigid : "auto" or sequence of str
        Markers that move with the skull, for :func:`evalkit.compensate`.
    label_map : mapping of str to str, or "position", optional
        Label -> marker site; ``"position"`` looks at where the markers are and at no label. By default the labels
        are site names or those of a set that the package knows.
    unmapped : {"place", "ignore"}
        Whether markers without a site are put on the head where they come to lie, or left out.
    neutral : "auto" or int
        Frame of rest, from 0; by default found as :func:`evalkit.animation.rest.rest_pose` does.
    gaps : {"hold", "interpolate"}
        What a marker does in gaps longer than :data:`~evalkit.animation.gaps.SHORT_GAP_S`.
    head_motion : {"take", "still", "idle"}
    fps : float, optional
        Frames shown per second. Each is the take at that instant: displacements in a straight line between the two
        nearest frames, rotations along the shortest turn, nothing smoothed. By default the take's own rate.
    kernel, seam : str
        As for :func:`evalkit.deformation_map`.
    seed : int
        Of blinks and idle motion.

    Returns
    -------
    Animation

    Raises
    ------
    EvalkitError
        If fewer than four markers can be used, a label or site is unknown, the head lacks a site that the scale
        needs, or an option is.

    References
    ----------
    Huang, Lin & Ouhyoung 2000, sections 3 and 4.
    """
    _check_options(head, unmapped, gaps, head_motion, fps)
    still, rotations, translations, pivot, notes = _head_motion_out(take, compensated, rigid)
    usable = _usable(take, still)
    sites, how = _sites(take, head, still, usable, label_map)
    lost = [f"{site} ({label})" for site, label in sites.items() if take.indices([label])[0] not in usable]
    if lost:
        notes.append(f"hardly or never seen and left out: {', '.join(lost)}")
    columns = {site: take.indices([label])[0] for site, label in sites.items()}
    columns = {site: column for site, column in columns.items() if column in usable}
    if len(columns) < FEWEST_MARKERS:
        raise EvalkitError(
            f"{len(columns)} markers of the take can drive the head ({', '.join(columns) or 'none'}); it takes "
            f"at least {FEWEST_MARKERS}: name more of them with --map Label=Site,..."
        )
    others = [k for k in usable if k not in columns.values()] if unmapped == "place" else []
    used = [*columns.values(), *others]
    rest, rest_frame = _rest(take, still[:, used], list(columns), neutral, used)
    known = len(columns)
    targets = np.array([head.marker_sites[site] for site in columns])
    alignment = align(rest[:known], targets)
    if align(rest[:known] * MIRROR, targets).residual_mm < MIRRORED * alignment.residual_mm:
        notes.append("the markers lie like the mirror image of a face: left and right labels are exchanged")
    placed = place_others(
        head,
        alignment,
        {site: (rest[k], head.marker_sites[site]) for k, site in enumerate(columns)},
        {take.labels[column]: rest[known + k] for k, column in enumerate(others)},
    )
    centres = {site: head.marker_sites[site] for site in columns}
    centres |= {marker.label: marker.position for marker in placed if not marker.reason}
    chosen = [*range(known), *(known + k for k, marker in enumerate(placed) if not marker.reason)]
    scales, ratios = _scales(head, alignment, list(columns), rest[:known], centres, notes)
    observed = alignment.directions(still[:, used][:, chosen] - rest[chosen]) * scales
    filled = fill_gaps(observed, take.rate, gaps)
    wrong = spikes(filled.values, take.rate)
    if wrong.any():
        notes.append(
            f"{int(wrong.sum())} marker positions jump away for a few frames and are taken as missing "
            f"({_ranges(np.asarray(wrong.any(axis=1)))})"
        )
        filled = fill_gaps(np.where(wrong[:, :, None], np.nan, observed), take.rate, gaps)
    rate, at = _shown(take, fps)
    driven = _lids_by_markers(head, dict(zip(centres, filled.values.transpose(1, 0, 2), strict=True)))
    moved = _resampled(filled.values, at)
    by_name = {name: moved[:, k] for k, name in enumerate(centres)}
    lids, lid_words = _lids(head, driven, at, take.rate, seed)
    deformation = _map(head, centres, kernel, seam, notes)
    jaw_deg, glide = jaw_motion(head, by_name)
    turned, shifted, beyond = _head_motion(
        head, alignment, head_motion, rotations, translations, (take.rate, at), gaps, seed, notes
    )
    nearest = np.rint(at).astype(np.intp)
    unknown_pose = np.asarray(~np.isfinite(rotations).all(axis=(1, 2)))
    held = np.asarray(filled.long.any(axis=1) | unknown_pose)[nearest]
    _gap_notes(filled, list(by_name), gaps, notes)
    if beyond.any():
        notes.append(
            f"the head turns beyond {LIMIT_DEG:g} degrees in {int(beyond.sum())} frames ({_ranges(beyond)}): "
            "a half-cut head does not look right there"
        )
    report = {
        "frames": len(at), "rate_hz": rate, "take_frames": take.frames, "take_rate_hz": take.rate,
        "resampling": "none" if rate == take.rate else "linear between the two nearest frames",
        "markers": {site: take.labels[column] for site, column in columns.items()}, "matched": how,
        "marker_order": list(by_name),
        "placed": {m.label: round(m.off_skin_mm, 2) for m in placed if not m.reason},
        "left_out": {m.label: m.reason for m in placed if m.reason},
        "alignment": {"scale": alignment.scale, "residual_mm": alignment.residual_mm},
        "scaling": {
            key: {"distance": r.name, "performer_mm": r.performer_mm, "head_mm": r.head_mm, "ratio": r.ratio}
            for key, r in ratios.items()
        },
        "neutral_frame": rest_frame, "neutral": "given" if neutral != "auto" else "found with the mouth closed",
        "gaps": {
            "mode": gaps, "short_values": int(filled.short.sum()), "long_values": int(filled.long.sum()),
            "spikes": int(wrong.sum()), "marked_frames": int(held.sum()),
            "frames_without_head_pose": int(unknown_pose.sum()),
        },
        "lids": lid_words, "largest_jaw_opening_deg": float(jaw_deg.max(initial=0.0)),
        "head_motion": head_motion, "frames_beyond_2.5d": int(beyond.sum()),
        "kernel": deformation.kernel, "seam": deformation.seam, "notes": notes,
    }  # fmt: skip
    shown = np.array(used)[chosen]
    raw, without = (
        alignment.directions(points[np.ix_(nearest, shown)] - alignment.performer) for points in (take.points, still)
    )
    return Animation(
        head, rate, at, deformation, moved, lids, jaw_deg, glide, turned, shifted,
        raw, without, None if pivot is None else alignment.directions(pivot - alignment.performer),
        {m.label: m.position for m in placed if not m.reason}, held, report,
    )  # fmt: skip


def _check_options(head: Head, unmapped: str, gaps: str, head_motion: str, fps: float | None) -> None:
    for option, value, known in (
        ("unmapped", unmapped, UNMAPPED), ("gaps", gaps, MODES), ("head motion", head_motion, HEAD_MOTION),
    ):  # fmt: skip
        if value not in known:
            raise EvalkitError(f"{option} '{value}' is not known; use {' or '.join(known)}")
    if fps is not None and not (np.isfinite(fps) and 1.0 <= fps <= 240.0):
        raise EvalkitError(f"{fps:g} frames per second cannot be shown; use 1 to 240")
    if len(head.marker_sites) < FEWEST_MARKERS:
        raise EvalkitError(f"{head.name}: has {len(head.marker_sites)} marker sites; markers need somewhere to be put")


def _head_motion_out(
    take: Capture, compensated: bool, rigid: str | Sequence[str]
) -> tuple[Array, Array, Array, Array | None, list[str]]:
    """Points without head motion, the motion, its pivot, and what is to be known about it."""
    if compensated:
        rotations = np.repeat(np.eye(3)[None], take.frames, axis=0)
        return take.points, rotations, np.zeros((take.frames, 3)), None, list(take.warnings)
    result = compensate(take, rigid)
    lost = int((result.frame_status != FrameStatus.OK).sum())
    # Where the neck's pivot is, and whether it sways, changes nothing that is seen here: the pose does.
    notes = [words for words in result.warnings if not words.startswith(("pivot ", "the pivot "))]
    if lost == take.frames:
        raise EvalkitError("no frame of the take gives a head pose; name rigid markers with --rigid")
    return result.capture.points, result.rotations, result.translations, result.pivot, notes


def _usable(take: Capture, still: Array) -> list[int]:
    seen = np.mean(np.isfinite(still[:, :, 0]), axis=0).tolist()
    return [k for k, kind in enumerate(take.quantities) if kind == "position" and seen[k] >= LEAST_SEEN]


def _sites(
    take: Capture, head: Head, still: Array, usable: list[int], label_map: str | Mapping[str, str] | None
) -> tuple[dict[str, str], str]:
    """Marker site -> label, and how it was found."""
    if label_map == BY_POSITION:
        up, forward = screen_axes(take)
        places, _ = rest_pose(still[:, usable], None)
        found = match_positions(places, np.stack([np.cross(up, forward), up, forward]), head.marker_sites)
        return {site: take.labels[usable[k]] for site, k in found.items()}, "by position"
    if isinstance(label_map, str):
        raise EvalkitError(f"mapping '{label_map}' is not known; give label -> site, or '{BY_POSITION}'")
    labels = [label for label, kind in zip(take.labels, take.quantities, strict=True) if kind == "position"]
    return match_labels(labels, head.marker_sites, label_map)


def _rest(take: Capture, still: Array, sites: list[str], neutral: str | int, used: list[int]) -> tuple[Array, int]:
    """Rest of the used markers, mm, and its frame."""
    if isinstance(neutral, str):
        if neutral != "auto":
            raise EvalkitError(f"neutral '{neutral}' is not known; use auto or a frame from 0")
        lips = None
        for upper, lower in (("UpperLipC", "LowerLipC"), ("UpperLipL", "LowerLipL"), ("UpperLipR", "LowerLipR")):
            if lips is None and upper in sites and lower in sites:
                lips = (sites.index(upper), sites.index(lower))
        return rest_pose(still, lips)
    if not 0 <= neutral < take.frames:
        raise EvalkitError(f"neutral frame {neutral} is not one of the take's 0 to {take.frames - 1}")
    rest = still[neutral]
    missing = [take.labels[used[k]] for k in np.flatnonzero(~np.isfinite(rest[:, 0]))]
    if missing:
        raise EvalkitError(
            f"neutral frame {neutral}: {', '.join(missing[:5])} {'is' if len(missing) == 1 else 'are'} not seen "
            "there; choose another frame"
        )
    return rest, neutral


def _scales(
    head: Head, alignment: Alignment, sites: list[str], rest: Array, centres: Mapping[str, Array], notes: list[str]
) -> tuple[Array, Mapping[str, Ratio]]:
    """Factor of every centre and axis (n, 3), and the ratios that it comes from."""
    needed = list(dict.fromkeys(name for m in MEASURES.values() for name in (*m.first, *m.second)))
    lacking = next((name for name in needed if name not in head.marker_sites), None)
    if lacking is not None:
        raise EvalkitError(f"{head.name}: has no marker site {lacking}, which the scale from performer to head needs")
    missing = [name for name in needed if name not in sites]
    if missing:
        notes.append(f"without {', '.join(missing)} the displacements are scaled alike, by {alignment.scale:.3g}")
        return np.full((len(centres), 3), alignment.scale), {}
    lying = alignment.directions(rest - alignment.performer)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = performer_scaling(head, dict(zip(sites, lying, strict=True)))
    notes += [str(entry.message) for entry in caught]
    scale_of = dict(zip(found.labels, found.scales, strict=True))
    places = np.array([head.marker_sites[site] for site in sites])
    # A marker without a site belongs to the half of the face of its nearest neighbour.
    near = [sites[int(np.linalg.norm(places - place, axis=1).argmin())] for place in centres.values()]
    return np.array([scale_of[name] for name in near]), found.ratios


def _map(head: Head, centres: Mapping[str, Array], kernel: str, seam: str, notes: list[str]) -> Deformation:
    """The deformation map; one field for a face whose lips have no markers."""
    upper = any(name in LOWER_FACE and name.startswith("Upper") for name in centres)
    lower = any(name in LOWER_FACE and not name.startswith("Upper") for name in centres)
    regions = upper and lower and all(len(head.regions.get(name, ())) for name in ("upper lip", "lower lip"))
    if not regions:
        notes.append("the lips have no markers of their own, or the head no lips: one field moves the whole face")
    found = deformation_report(head, centres, kernel, regions, seam=seam)
    notes += found.notes
    return found


def _shown(take: Capture, fps: float | None) -> tuple[float, Array]:
    """Rate and the frames of the take, fractional, that are shown."""
    rate = take.rate if fps is None else float(fps)
    if rate == take.rate:
        return rate, np.arange(take.frames, dtype=np.float64)
    count = int(np.floor((take.frames - 1) / take.rate * rate + 1e-9)) + 1
    return rate, np.minimum(np.arange(count) * (take.rate / rate), take.frames - 1.0)


def _resampled(values: Array, at: Array) -> Array:
    """Values (F, ...) at fractional frames, in a straight line between the two nearest."""
    low = np.minimum(at.astype(np.intp), max(len(values) - 2, 0))
    share = (at - low).reshape(-1, *[1] * (values.ndim - 1))
    return values[low] + share * (values[np.minimum(low + 1, len(values) - 1)] - values[low])


def _lids_by_markers(head: Head, displacement: dict[str, Array]) -> dict[str, Array]:
    """Lid site -> how far it is closed (F,), for lid markers that blink.

    What a lid marker does to close the lid is taken out of its displacement, in place: the lid slides over the
    eyeball, and does not drag the skin around it along.
    """
    driven = driven_lids(head, displacement)
    for name, amount in driven.items():
        displacement[name] *= (1.0 - amount)[:, None]
        np.maximum(displacement[name][:, 1], 0.0, out=displacement[name][:, 1])
    return driven


def _lids(head: Head, driven: dict[str, Array], at: Array, rate: float, seed: int) -> tuple[Array, dict[str, Any]]:
    """How far the lids are closed in every frame shown (F, 2), and in words where that comes from."""
    if driven:
        # A lid whose marker is missing blinks with the other one: they do.
        one = next(iter(driven.values()))
        closed = np.stack([driven.get(name, one) for name in LID_SITES], axis=1)
        return _resampled(closed, at), {"source": "markers", "markers": list(driven)}
    starts = blink_times(float(at[-1] / rate), seed) if head.lids is not None else np.zeros(0)
    track = blink_track(at / rate, starts)
    return np.stack([track, track], axis=1), {"source": "generated", "blinks": len(starts), "seed": seed}


def _head_motion(
    head: Head, alignment: Alignment, mode: str, rotations: Array, translations: Array, shown: tuple[float, Array],
    gaps: str, seed: int, notes: list[str],
) -> tuple[Array, Array, np.ndarray]:  # fmt: skip
    """Motion of the head in every frame shown, and which frames turn too far."""
    rate, at = shown
    if mode != "take":
        turned = np.repeat(np.eye(3)[None], len(at), axis=0)
        shifted = np.zeros((len(at), 3))
        if mode == "idle":
            turned, shifted = idle_motion(at / rate, seed)
        return turned, shifted, beyond_limit(turned)
    turned = fill_rotations(rotations, rate, gaps)
    # Where the head is, not T itself: T depends on where the world's origin lies, and so would what a gap shows.
    middle = np.einsum("fij,j->fi", rotations, alignment.performer) + translations
    middle = fill_gaps(middle[:, None], rate, gaps).values[:, 0]
    turned, middle = resample_rotations(turned, at), _resampled(middle, at)
    shift = middle - np.einsum("fij,j->fi", turned, alignment.performer)
    turned, shifted = alignment.motion(turned, shift)
    low, high = head.vertices.min(axis=0), head.vertices.max(axis=0)
    turned, shifted, cut = within_picture(turned, shifted, (low + high) / 2)
    if cut:
        notes.append("the head travels out of the picture: only its turns are shown")
    return turned, shifted, beyond_limit(turned)


def _gap_notes(filled: Filled, names: list[str], mode: str, notes: list[str]) -> None:
    if filled.long.any():
        worst = sorted(zip(filled.long.sum(axis=0), names, strict=True), reverse=True)[:4]
        listed = ", ".join(f"{name} {count}" for count, name in worst if count)
        done = "held" if mode == "hold" else "bridged"
        frames = int(filled.long.any(axis=1).sum())
        notes.append(f"long gaps in {frames} frames are {done} and marked in the picture (frames missing: {listed})")


def _ranges(mask: np.ndarray, most: int = 4) -> str:
    """Runs of true frames as text."""
    edge = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    runs = [f"{a}" if b - a == 1 else f"{a}-{b - 1}" for a, b in zip(edge[::2], edge[1::2], strict=True)]
    return ", ".join(runs[:most]) + (" ..." if len(runs) > most else "")
