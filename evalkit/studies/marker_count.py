"""Fewer and more markers than the paper's 23.

Question: what is another marker worth, and which kernel makes use of it?

Finding: -

Command: ``evalkit study run marker-count --budget full``.
"""

from __future__ import annotations

from evalkit.geometry import Array
from evalkit.studies.dense_takes import (
    DENSE_COLUMNS,
    DENSE_FIGURES,
    DenseTake,
    build_map,
    dense_face,
    dense_take,
    more_markers,
    score_map,
)
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Study
from evalkit.study.figures import median

NOISE_MM = 0.3
"""Of an ordinary capture; without it more markers could only help."""


def prepare(seed: int, head: str, markers: int) -> DenseTake:
    """A performance seen by so many markers."""
    return dense_take(head, seed, NOISE_MM, more_markers(dense_face(head), markers))


def run(data: DenseTake, method: str) -> tuple[Array, float]:
    """The map of a kernel with regions."""
    return build_map(data, method)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="marker-count",
    question=QUESTION,
    finding=FINDING,
    axes={"head": ("template",), "markers": (8, 12, 16, 23, 32, 48, 63, 90, 120)},
    methods=("exponential", "biharmonic", "thin-plate", "matern-3-2", "bilaplacian"),
    prepare=prepare,
    run=run,
    score=score_map,
    columns=DENSE_COLUMNS,
    figures=(*DENSE_FIGURES, median("condition", "condition number", "")),
    full=Budget(seeds=3),
    small=Budget(
        seeds=1,
        axes={"head": ("template 3000",), "markers": (8, 23, 63)},
        methods=("exponential", "biharmonic", "bilaplacian"),
    ),
)

if __name__ == "__main__":
    script(study)
