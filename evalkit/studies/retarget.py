"""Retargeting with and without the warp's Jacobian, over kernels and against Deformation Transfer.

Question: how near does a performer's motion on another head come to that head's own, and what does the Jacobian add?

Finding: with 2 seeds, each 12 mixtures of units and the jaw alone; root mean square errors over the motion in truth,
all vertices of the face / its lips. From all vertices of the source, with the Jacobian, without it, and Deformation
Transfer: on a head bent to a muzzle 0.13 / 0.17, 0.35 / 0.38, 0.33 / 0.32; on a person of other proportions 0.08 /
0.06, 0.04 / 0.04, 0.03 / 0.02; on an identity of ICT-FaceKit 0.07 / 0.07, 0.06 / 0.06, 0.04 / 0.04; ICT-FaceKit's
shapes on MakeHuman's head, beside what its artist made, 0.41 / 0.40, 0.41 / 0.39, 0.43 / 0.43; the other way 0.38 /
0.34, 0.37 / 0.33, 0.38 / 0.37. So the Jacobian matters where proportions are far apart, and between human faces it
does not help. Three of the pairs decide that by how they are made: a muzzle's truth is bent with space, which is what
the Jacobian follows to first order, and a person's muscles and an identity's shapes move by the same millimetres
whatever the face, which is what is done without it. Only the two artists are no party to it. Deformation Transfer is
given the true correspondence on the pairs of one topology, which the others have to find. Kernels differ little
between human faces (0.40 to 0.42 and 0.37 to 0.40); on the muzzle the rounded biharmonic one is best (0.13; biharmonic
0.14, thin plate 0.14, cubic 0.20, Gaussian 0.27). With the jaw alone the mouth of the muzzle opens by 1.38 times as
much as in truth, an arc of 20 mm being more than first order; without the Jacobian by 0.93 times; MakeHuman's by 1.15
and 1.09, ICT-FaceKit's by 0.85 and 0.91. Lids are the worst part (0.80 to 0.94 between the artists, 0.32 on an
identity). From markers, with the Jacobian, by the toolkit's map / barycentrically / the same without slits, all
vertices: person 0.45 / 0.62 / 0.64, muzzle 0.45 / 0.61 / 0.63, identity 0.33 / 0.42 / 0.49, MakeHuman 0.44 / 0.55 /
0.58, ICT-FaceKit 0.42 / 0.49 / 0.55; lips 0.19 / 0.19 / 0.34, 0.21 / 0.22 / 0.35, 0.30 / 0.28 / 0.44, 0.37 / 0.36 /
0.46, 0.41 / 0.36 / 0.51. Without slits, as in the paper, lips stick together. The barycentric spread loses between
chin and neck, where no markers are; at the brows it is as good. Wrong landmarks are worse than no motion at all
everywhere (2.9 and more).

Command: ``evalkit study run retarget --budget full``
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.control.retargeting import Transfer, retarget
from evalkit.control.slits import vertex_sides
from evalkit.control.source import point_places, spreads
from evalkit.control.targets import as_identity, checked_target
from evalkit.control.warp import DEFAULT
from evalkit.dense import muscle_face
from evalkit.dense.actors import ICT_FILE
from evalkit.dense.muzzle import muzzle_warp
from evalkit.dense.two_artists import artists, heads_correspondence
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head, load_head
from evalkit.head.fitting import carried
from evalkit.head.ict import read_ict
from evalkit.metrics import vertex_error_mm
from evalkit.seeds import generator
from evalkit.studies.persons import person
from evalkit.studies.takes import told
from evalkit.studies.transfers import present
from evalkit.study.command import script
from evalkit.study.description import Budget, Condition, Expected, Study
from evalkit.study.statistics import mean, relative_to, root_mean_square
from evalkit.transfer.correspondence import Correspondence, same_topology
from evalkit.transfer.deformation_transfer import DeformationTransfer, still_vertices

STILL = "no motion"
"""The reference row: a target that stays as it is."""

JACOBIAN, WITHOUT, WRONG, DEFORMATION = "jacobian", "no jacobian", "wrong landmarks", "deformation transfer"
KERNELS = ("biharmonic", "thin-plate", "cubic", "multiquadric", "gaussian", "exponential")

DENSE = "dense"
"""Where the source's motion comes from: all its vertices; or its markers, by a way to spread them."""

EXPRESSIONS, UNITS = 12, (1, 3)
"""Random mixtures of so many units of the source, besides the jaw alone."""

BROW_MM = 18.0
"""The brows are the skin so near to their marker sites."""

LEFT_OUT = ("eyeLook", "tongue", "Pupil")
"""Shapes of what is not skin."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two heads and the same expressions of both, the jaw's opening first.

    Attributes
    ----------
    source, target : Head
    moves, truth : ndarray, shape (N, V, 3), mm
        Displacements of the source's vertices, and true ones of the target's.
    between : Correspondence
        Of the soft parts' triangles, for Deformation Transfer.
    motion : str
        Where the methods get the source's motion from.
    """

    source: Head
    target: Head
    moves: Array
    truth: Array
    between: Correspondence
    motion: str


def prepare(seed: int, pair: str, motion: str) -> Pair:
    """Both heads and their expressions; the seed draws the person, where there are several, and the mixtures."""
    made = _pairs(pair.split(" of ")[0])(seed, _count(pair))
    return replace(made, motion=motion)


def _count(pair: str) -> int | None:
    """Vertices of the built-in head, ``template to person of 2000``."""
    _, _, count = pair.partition(" of ")
    return int(count) if count else None


def _pairs(name: str) -> Any:
    found = {
        "template to person": _to_person,
        "template to muzzle": _to_muzzle,
        "ict to identity": _to_identity,
        "ict to makehuman": lambda seed, count: _between(name, seed),
        "makehuman to ict": lambda seed, count: _between(name, seed),
    }
    if name not in found:
        raise EvalkitError(f"pair '{name}' is not known; known are {', '.join(found)}")
    return found[name]


def _mixtures(units: int, jaw: int, seed: int) -> Array:
    """Amounts (N, units): the jaw alone, then random mixtures."""
    draw = generator("retarget mixtures", units, seed=seed)
    out = np.zeros((EXPRESSIONS + 1, units))
    out[0, jaw] = 1.0
    for row in out[1:]:
        which = draw.choice(units, int(draw.integers(UNITS[0], UNITS[1] + 1)), replace=False)
        row[which] = draw.uniform(0.4, 1.0, len(which))
    return out


def _acted(head: Head, seed: int) -> Array:
    """Displacements (N, V, 3) of a head with muscles."""
    face = muscle_face(head)
    amounts = _mixtures(len(face.units), face.units.index("jaw"), seed)
    return face.positions(dict(zip(face.units, amounts.T, strict=True))) - head.vertices


def _to_person(seed: int, count: int | None) -> Pair:
    """The built-in head and a person of other proportions, each with muscles of its own."""
    who = person(seed, count)
    return _of_one_topology(who.generic, who.head, _acted(who.generic, seed), _acted(who.head, seed))


def _to_muzzle(seed: int, count: int | None) -> Pair:
    """The built-in head and one bent to a muzzle, whose expressions are bent with it."""
    head = load_head("template", vertices=count)
    return to_muzzle(head, _acted(head, seed))


def to_muzzle(head: Head, moves: Array) -> Pair:
    """A head's expressions, displacements (N, V, 3), mm, and what becomes of them where space is bent to a muzzle."""
    warp = muzzle_warp(head, 0.5 * (head.landmarks["upper lip"] + head.landmarks["lower lip"]))
    there = warp(head.vertices)
    truth = np.stack([warp(head.vertices + one) for one in moves]) - there
    return _of_one_topology(head, replace(carried(head, warp), vertices=there), moves, truth)


def _of_one_topology(source: Head, target: Head, moves: Array, truth: Array) -> Pair:
    soft = _soft(source)[1]
    return Pair(source, target, moves, truth, same_topology(soft), DENSE)


def _soft(head: Head) -> tuple[Any, Any]:
    """Soft vertices of a head, and triangles among them."""
    soft = head.soft_vertices
    number = np.full(len(head.vertices), -1)
    number[soft] = np.arange(len(soft))
    return soft, number[head.part_triangles("skin", "lids", "mouth pocket")]


@lru_cache(maxsize=1)
def _ict() -> Head:
    folder = os.environ.get("EVALKIT_REAL_DATA")
    if not folder:
        raise EvalkitError("pair ict to identity: set EVALKIT_REAL_DATA to the folder that holds " + "/".join(ICT_FILE))
    return read_ict(Path(folder, *ICT_FILE))


def _to_identity(seed: int, count: int | None) -> Pair:
    """ICT-FaceKit's mean face and one of its identities, to which the model adds the same expressions."""
    head = _ict()
    names = [name for name in head.blendshapes if not name.startswith(("identity", *LEFT_OUT))]
    moves = _mixed({name: _whole(head, name) for name in names}, names, seed)
    return _of_one_topology(head, as_identity(head, f"identity{seed % 8:03d}"), moves, moves)


def _whole(head: Head, name: str) -> Array:
    out = np.zeros_like(head.vertices)
    which, moves = head.blendshapes[name]
    out[which] = moves
    return out


def _mixed(shapes: Mapping[str, Array], names: list[str], seed: int) -> Array:
    return np.tensordot(_mixtures(len(names), names.index("jawOpen"), seed), np.stack([shapes[n] for n in names]), 1)


def _between(direction: str, seed: int) -> Pair:
    """One artist's expressions on the other's head, beside what the other sculpted under the same names."""
    folder = os.environ.get("EVALKIT_REAL_DATA")
    if not folder:
        raise EvalkitError(f"pair {direction}: set EVALKIT_REAL_DATA to the folder that holds " + "/".join(ICT_FILE))
    both = artists(Path(folder, *ICT_FILE))
    source, target = (both[name] for name in direction.split(" to "))
    names = [name for name in source.shapes if not name.startswith(LEFT_OUT)]
    moves, truth = (_mixed(one.shapes, names, seed) for one in (source, target))
    return Pair(source.head, target.head, moves, truth, heads_correspondence(source, target), DENSE)


def run(data: Pair, method: str) -> Array:
    """Displacements (N, V, 3), mm, of the target."""
    if method == STILL:
        return np.zeros_like(data.truth)
    if method == DEFORMATION:
        return _deformation_transfer(data)
    target = data.target
    if method == WRONG:
        places = list(target.landmarks.values())
        target = replace(target, landmarks=dict(zip(target.landmarks, places[1:] + places[:1], strict=True)))
    kernel = method if method in KERNELS else DEFAULT
    jacobian = method != WITHOUT
    if data.motion == DENSE:
        return Transfer(data.source, target, kernel, jacobian).displacements(data.moves)
    near = data.source.nearest_vertices(point_places(data.source) | data.source.marker_sites)
    which = list(near.values())
    made = retarget(
        list(near), data.source.vertices[which], data.moves[:, which], target, kernel=kernel, jacobian=jacobian,
        spread=data.motion,
    )  # fmt: skip
    return made.bases.bases.astype(np.float64)


def _deformation_transfer(data: Pair) -> Array:
    (own, triangles), (there, faces) = _soft(data.source), _soft(data.target)
    rest, shapes = data.source.vertices[own], (data.source.vertices + data.moves)[:, own]
    pinned = still_vertices(rest, triangles, shapes, faces, data.between)
    transfer = DeformationTransfer(rest, triangles, data.target.vertices[there], faces, data.between, pinned)
    out = np.zeros_like(data.truth)
    out[:, there] = transfer.transfer(shapes) - data.target.vertices[there]
    return out


PARTS = ("all", "lips", "lids", "brows")

COLUMNS = {
    **{f"{part}_mm": f"rms distance from truth of the vertices of the skin, {part}, mm" for part in PARTS},
    **{f"{part}_share": "the same over the rms motion in truth" for part in PARTS},
    "opening_share": "opening of the mouth with the jaw alone, upper less lower lip, over that in truth",
    "upper_lip_mm": "how far the middle of the upper lip goes down with the jaw alone, less that in truth, mm",
    "lids_follow_mm": "rms motion of the lids with the jaw alone, less that in truth, mm",
}  # fmt: skip


def parts_of(head: Head) -> dict[str, Any]:
    """Vertices of the outer skin that errors are told of."""
    head = checked_target(head)
    skin = head.skin_vertices
    lips = np.concatenate([head.regions[lip] for lip in ("upper lip", "lower lip")])
    face = np.intersect1d(np.concatenate([head.regions["face"], lips]), skin)
    brows = np.array([head.marker_sites[f"Brow{end}{side}"] for end in ("In", "Out") for side in "LR"])
    near = (np.linalg.norm(head.vertices[face][:, None] - brows, axis=2) < BROW_MM).any(axis=1)
    lids = np.flatnonzero((vertex_sides(head)[:, 1:] != 0).any(axis=1))
    return {
        "all": face, "lips": np.intersect1d(lips, skin), "lids": np.intersect1d(lids, skin), "brows": face[near],
    }  # fmt: skip


def score(data: Pair, result: Array) -> dict[str, Any]:
    """Errors by part of the face, and what mouth and lids do when the jaw opens."""
    out: dict[str, Any] = {}
    off, way = vertex_error_mm(result, data.truth), np.linalg.norm(data.truth, axis=2)
    parts = parts_of(data.target)
    for part, which in parts.items():
        out[f"{part}_mm"] = float(np.sqrt((off[:, which] ** 2).mean()))
        out[f"{part}_share"] = out[f"{part}_mm"] / float(np.sqrt((way[:, which] ** 2).mean()))
    near = data.target.nearest_vertices(data.target.landmarks)
    upper, lower = ([one[0, near[lip], 1] for one in (result, data.truth)] for lip in ("upper lip", "lower lip"))
    out["opening_share"] = float((upper[0] - lower[0]) / (upper[1] - lower[1]))
    out["upper_lip_mm"] = float(upper[1] - upper[0])
    lids = [float(np.sqrt((one[0, parts["lids"]] ** 2).sum(axis=1).mean())) for one in (result, data.truth)]
    out["lids_follow_mm"] = lids[0] - lids[1]
    return out


def applies(condition: Condition, method: str) -> bool:
    """Deformation Transfer needs all vertices; kernels are told apart on dense motion; absent heads fail once."""
    pair, motion = str(condition["pair"]), condition["motion"]
    if not present(" ".join(word for word in pair.split() if word in ("ict", "makehuman"))):
        return method == STILL
    return motion == DENSE or method in (STILL, JACOBIAN, WITHOUT, WRONG)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="retarget",
    question=QUESTION,
    finding=FINDING,
    axes={
        "pair": (
            "template to person", "template to muzzle", "ict to identity", "ict to makehuman", "makehuman to ict",
        ),
        "motion": (DENSE, *spreads),
    },
    methods=(STILL, JACOBIAN, WITHOUT, *KERNELS, DEFORMATION, WRONG),
    prepare=prepare,
    run=run,
    score=score,
    columns=COLUMNS,
    statistics=(
        *(root_mean_square(f"{part}_share", f"{part} over motion", "") for part in PARTS),
        root_mean_square("all_mm", "all", "mm"),
        mean("opening_share", "opening of the mouth", "", less=None),
        mean("upper_lip_mm", "upper lip follows the jaw", "mm", less=None),
        mean("lids_follow_mm", "lids follow the jaw", "mm", less=None),
        relative_to("all_mm", WITHOUT, "all over no jacobian"),
        relative_to("all_mm", DEFORMATION, "all over deformation transfer"),
    ),
    full=Budget(seeds=2),
    small=Budget(
        seeds=1,
        axes={"pair": ("template to person of 1000", "template to muzzle of 1000"), "motion": (DENSE, "barycentric")},
        methods=(STILL, JACOBIAN, WITHOUT, DEFORMATION, WRONG),
    ),
    applies=applies,
    expected=(
        # No motion at all scores 1.
        Expected("all over motion", JACOBIAN, 1.0),
        Expected("lips over motion", JACOBIAN, 1.0),
        Expected("all over motion", WRONG, 1.0, least=True),
    ),
)  # fmt: skip

if __name__ == "__main__":
    script(study)
