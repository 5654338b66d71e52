"""Takes of your own, without truth: a marker is left out, and how still each method leaves it is measured.

Question: on your own takes, which method leaves a marker stillest that it did not see?

A marker that should sit on the skull is taken out of the take, the head motion is estimated from what remains, and
the marker is brought to the reference pose by it. How far it still moves is its own motion over the skull, the same
for every method, plus the error of the estimate. So the method with the smallest figure is the one for this take; one
that is above ``raw``, no compensation at all, does harm. Try several markers: one alone may sit on skin that moves
together with the others, and differences of a few percent between methods say nothing.

Finding: on two takes of one performer with 41 markers (AnimFace, ``jaw`` and ``cheeks``; NoseTop, Leye_Inside and
Reye_Inside left out in turn; motion without compensation 2.7 to 4.0 mm) the automatic weighting of all markers, told
no labels, leaves 0.54, 0.57 and 0.94 mm, and 1.46, 1.76 and 1.11 mm: everywhere less than the forehead triangle (1.04,
1.01, 1.26; 2.49, 2.30, 2.19) and in five of six cases less than least squares over six markers picked by hand (0.72,
0.71, 1.06; 1.77, 1.74, 1.20). Among those six, weights from how their skin moves help in ``jaw`` (0.62, 0.56, 0.95: as
good as all markers) and hurt in ``cheeks`` (1.92, 1.76, 1.43); robust re-weighting helps less and hurts less (1.76,
1.70, 1.25). Turning the head about a pivot changes nothing (0.71, 0.69, 1.06; 1.77, 1.74, 1.19): in takes with a few
degrees of motion what skin does is larger than what a pivot tells. Which method is best does depend on the marker, so
look at several.

Command: ``evalkit study run real-takes --budget full --axis take=a.c3d,b.c3d``, and, by choice,

- ``--axis held_out=NoseTop,Leye_Inside``: a table for each; ``--axis "held_out=NoseTop + Leye_Inside"``: one for both,
  in turn. By default every marker that evalkit calls rigid in that file, in turn.
- ``--axis candidates=A,B,C,D``: markers that may be rigid; by default those that evalkit calls so without the one left
  out.
- ``--axis triangle=A,B,C``: the three of the paper's way; by default those whose labels begin with ``forehead``, else
  the best three.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from evalkit.capture import Capture, read_capture
from evalkit.capture.rigid import choose_rigid
from evalkit.compensation import compensate
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, undo_motion
from evalkit.metrics import rms
from evalkit.pose import pose_estimators, reference_pose
from evalkit.pose.skin import skin_model
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Expected, Scalar, Study
from evalkit.study.statistics import mean, relative_to, root_mean_square

AUTO = "auto"
AND = " + "
"""Between the labels in one value of an axis."""

RAW = "raw"


@dataclass(frozen=True, eq=False)
class LeftOut:
    """A take without one marker, and that marker.

    Attributes
    ----------
    label : str
        Of the marker.
    path : ndarray, shape (F, 3), mm
        Where it was observed; no method sees it.
    rest : Capture
        The take without it.
    candidates, triangle : list of str
        Markers of the rest that may be rigid, and the three of the paper's way.
    """

    label: str
    path: Array
    rest: Capture
    candidates: list[str]
    triangle: list[str]


def conditions(axes: Mapping[str, tuple[Scalar, ...]]) -> Iterator[Condition]:
    """One condition for every take and marker left out, or several in turn: ``A + B``, and all where none is named.

    Raises
    ------
    EvalkitError
        If no take is named, a file cannot be read, or a label is not in it.
    """
    if not axes["take"]:
        raise EvalkitError("real-takes: name your files, such as --axis take=a.c3d,b.c3d")
    candidates, triangle = (AND.join(map(str, axes[name])) for name in ("candidates", "triangle"))
    for name in map(str, axes["take"]):
        take = read_capture(name)
        for label in axes["held_out"]:
            each = choose_rigid(take).labels if label == AUTO else str(label).split(AND)
            for held_out in each:
                left_out(take, held_out, candidates, triangle)  # a wrong label is told before anything is measured
            yield {"take": name, "held_out": AND.join(each), "candidates": candidates, "triangle": triangle}


def left_out(take: Capture, label: str, candidates: str, triangle: str) -> LeftOut:
    """A take without one of its markers; what is chosen automatically is chosen without it.

    Raises
    ------
    EvalkitError
        If a label is not in the take, or three markers do not remain.
    """
    at = take.indices([label])[0]
    kept = [k for k in range(len(take.labels)) if k != at]
    labels = [take.labels[k] for k in kept]
    kinds = [take.quantities[k] for k in kept]
    rest = Capture(take.points[:, kept], labels, take.rate, axes=take.axes, quantities=kinds)
    given = choose_rigid(rest).labels if candidates == AUTO else _without(take, candidates, label)
    three = _forehead(rest) if triangle == AUTO else _without(take, triangle, label)
    return LeftOut(label, take.points[:, at], rest, given, three)


def _without(take: Capture, joined: str, label: str) -> list[str]:
    """Labels of one value of an axis without one of them, all known to the take."""
    labels = joined.split(AND)
    take.indices(labels)
    return [name for name in labels if name != label]


def _forehead(take: Capture) -> list[str]:
    """The three markers of the forehead by their labels, or those that promise the smallest rotation error."""
    named = [label for label in take.labels if label.lower().startswith("forehead")]
    return named if len(named) == 3 else choose_rigid(take, size=3).labels


def prepare(seed: int, take: str, held_out: str, candidates: str, triangle: str) -> list[LeftOut]:
    """The take without each of the markers in turn; nothing in it is random, and the seed is not used."""
    whole = read_capture(take)
    return [left_out(whole, label, candidates, triangle) for label in held_out.split(AND)]


Motion = tuple[Array, Array]
"""Rotations (F, 3, 3) and translations (F, 3) of the head."""


def _raw(data: LeftOut) -> Motion:
    frames = data.rest.frames
    return np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3))


def _svd(data: LeftOut, name: str) -> Motion:
    return _compensated(data, getattr(data, name), pose="svd", pivot="svd", sway="per-frame")


def _weighted(data: LeftOut) -> Motion:
    """Least squares over the candidates, each weighted by how its skin moves against the other candidates."""
    points = data.rest.points[:, data.rest.indices(data.candidates)]
    weights = skin_model(points, data.candidates).weights
    pose = reference_pose(pose_estimators["svd"], points, weights=weights, labels=data.candidates)
    return pose.rotations, pose.translations


def _compensated(data: LeftOut, rigid: Any = AUTO, **options: Any) -> Motion:
    result = compensate(data.rest, rigid, **options)
    return result.rotations, result.translations


def _candidates(data: LeftOut, **options: Any) -> Motion:
    return _compensated(data, data.candidates, **options)


METHODS: dict[str, Callable[[LeftOut], Motion]] = {
    RAW: _raw,
    "svd triangle": partial(_svd, name="triangle"),
    "svd candidates": partial(_svd, name="candidates"),
    "svd weighted": _weighted,
    "robust": partial(_candidates, pose="robust", pivot="svd", sway="per-frame"),
    "joint": _candidates,
    "auto": _compensated,
}
"""Method -> head motion of a take without one marker."""


def run(data: list[LeftOut], method: str) -> list[Array]:
    """Every left-out marker in the reference pose, (F, 3), NaN where it or the head pose is unknown."""
    stilled = []
    for one in data:
        rotations, translations = METHODS[method](one)
        stilled.append(undo_motion(rotations, translations, one.path[:, None])[:, 0])
    return stilled


def score(data: list[LeftOut], stilled: list[Array]) -> dict[str, Any]:
    """How far the left-out markers still move.

    Raises
    ------
    EvalkitError
        If no frame shows one of them with a head pose.
    """
    moves = {}
    for one, path in zip(data, stilled, strict=True):
        seen = np.isfinite(path).all(axis=1)
        if not seen.any():
            raise EvalkitError(f"no frame shows {one.label} together with a head pose")
        moves[one.label] = rms(np.linalg.norm(path[seen] - path[seen].mean(axis=0), axis=1))
    worst = max(moves, key=lambda label: moves[label])
    shown = [np.isfinite(one.path[:, 0]).sum() for one in data]
    answered = [np.isfinite(path[:, 0]).sum() for path in stilled]
    return {
        "motion_mm": rms(list(moves.values())),
        "worst_mm": moves[worst],
        "posed": float(np.sum(answered) / np.sum(shown)),
        "each_mm": ", ".join(f"{label} {value:.4f}" for label, value in moves.items()),
        "candidates_used": "; ".join(AND.join(one.candidates) for one in data),
    }


QUESTION, FINDING = told(__doc__)

study = Study(
    name="real-takes",
    question=QUESTION,
    finding=FINDING,
    axes={"take": (), "held_out": (AUTO,), "candidates": (AUTO,), "triangle": (AUTO,)},
    methods=tuple(METHODS),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        "motion_mm": "rms distance of the stabilised left-out marker from its mean place (over markers: rms), mm",
        "worst_mm": "the same of the marker that moves most, mm",
        "posed": "share of the frames showing the marker that have a head pose; the figures are over these",
        "each_mm": "the figure of every marker, mm",
        "candidates_used": "candidates without the marker, for each marker",
    },
    statistics=(
        root_mean_square("motion_mm", "motion left", "mm"),
        root_mean_square("worst_mm", "of the worst marker", "mm"),
        relative_to("motion_mm", RAW, "over raw"),
        mean("posed", "frames posed", "", less=False),
    ),
    full=Budget(seeds=1),
    small=Budget(seeds=1),
    conditions=conditions,
    expected=(Expected("over raw", "auto", 1.0),),
)

if __name__ == "__main__":
    script(study)
