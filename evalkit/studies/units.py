"""A head in millimetres, centimetres and metres.

Question: is the map the same in any unit, and what does the paper's 64, taken literally, do in each?

Finding: with 3 seeds, the default map in cm and in m is that in mm to 5e-15. The template's eyes are 64.0 mm apart,
so that the paper's 64 taken as mm is the default length (difference 1e-5). Taken as 64 cm or 64 m it is another
kernel, in effect the biharmonic one that the exponential tends to for long lengths: weights differ by up to 0.06, the
error of all vertices by 0.01 mm (2.45 against 2.44) and that of the lips gets no worse (1.17 against 1.18). What
suffers is the paper's linear system as it is written: condition number 5e3 in mm, 6e3 in cm, 4e5 in m. The null-space
solution in inter-eye distances has 26, and 47 for either of the literal lengths.

Command: ``evalkit study run units --budget full``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evalkit.deform import deformation_report
from evalkit.deform.kernels import euclidean, exponential
from evalkit.geometry import Array
from evalkit.studies.dense_takes import DENSE_COLUMNS, DenseTake, dense_take, score_map
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.statistics import largest, median, root_mean_square

PER_MM = {"mm": 1.0, "cm": 0.1, "m": 0.001}

LITERAL = "64 as it stands"
DEFAULT = "fraction of the eyes"

PAPER_LENGTH = 64.0
"""``phi(r) = exp(-r / 64)``, Huang et al. 2000, Eq. (10), in the model's own unit."""


@dataclass(frozen=True, eq=False)
class InUnit:
    """A take, its head in a unit, and the map of the same head in mm."""

    take: DenseTake
    head: Any
    in_mm: Array


@dataclass(frozen=True, eq=False)
class Found:
    """A map with the condition of its systems: as solved here, and as the paper writes it."""

    weights: Array
    condition: float
    saddle: float


def prepare(seed: int, head: str, model_unit: str) -> InUnit:
    """A performance seen by the 23 markers; the head as it would be read from a file in this unit."""
    take = dense_take(head, seed)
    mm = take.face.head
    per = PER_MM[model_unit]
    sites = {name: per * place for name, place in mm.marker_sites.items()}
    scaled = replace(mm, vertices=per * mm.vertices, marker_sites=sites)
    return InUnit(take, scaled, deformation_report(mm, take.markers).weights)


def run(data: InUnit, method: str) -> Found:
    """The exponential kernel with its default length, or with 64 of whatever unit the head is in."""
    scale = PAPER_LENGTH if method == LITERAL else None
    found = deformation_report(data.head, data.take.markers, scale_mm=scale)
    assert found.scale_mm is not None
    saddle = saddle_condition(np.vstack([found.centres, found.static]), found.scale_mm)
    return Found(found.weights, max(field.condition for field in found.fields), saddle)


def saddle_condition(centres: Array, length: float) -> float:
    """Condition number of ``[[A, P], [P', 0]]`` with ``P = (1, x, y, z)``, as Eq. (10-11) would be solved, unscaled."""
    count = len(centres)
    matrix = np.zeros((count + 4, count + 4))
    matrix[:count, :count] = exponential(euclidean(centres, centres) / length)
    matrix[:count, count:] = np.hstack([np.ones((count, 1)), centres])
    matrix[count:, :count] = matrix[:count, count:].T
    return float(np.linalg.cond(matrix))


def score(data: InUnit, result: Found) -> dict[str, Any]:
    """Errors of the map on the performance, which has no unit, and its difference from that in mm."""
    return {
        **score_map(data.take, (result.weights, result.condition)),
        "difference": float(np.abs(result.weights - data.in_mm).max()),
        "saddle": result.saddle,
    }


QUESTION, FINDING = told(__doc__)

study = Study(
    name="units",
    question=QUESTION,
    finding=FINDING,
    axes={"head": ("template",), "model_unit": tuple(PER_MM)},
    methods=(DEFAULT, LITERAL),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        **DENSE_COLUMNS,
        "difference": "largest difference of a weight from that of the default map in mm",
        "saddle": "condition number of the paper's system with its affine part, face field, in this unit",
    },
    statistics=(
        largest("difference", "difference from mm", ""),
        median("condition", "condition number", ""),
        median("saddle", "condition of the paper's system", ""),
        root_mean_square("all_mm", "all moving", "mm"),
        root_mean_square("lips_mm", "lips", "mm"),
    ),
    full=Budget(seeds=3),
    small=Budget(seeds=1, axes={"head": ("template 3000",)}),
    # Rounding of a system of condition 1e3; one length off by a unit would make a difference of order 0.1.
    expected=(Expected("difference from mm", DEFAULT, 1e-9),),
)

if __name__ == "__main__":
    script(study)
