"""Fewer and more markers than the paper's 23.

Question: what is another marker worth, and which kernel makes use of it?

Finding: with 3 seeds and 0.3 mm of noise, rms mm of all moving skin / lips, exponential: 8 markers 3.02 / 1.59, 16
2.96 / 1.58, the paper's 23 2.46 / 1.25, 32 2.12 / 1.25, 48 1.26 / 1.25, 63 1.24 / 1.25, 120 0.97 / 1.19. The 25 markers
after the paper's are worth most, since the first places far from any other are those along the jaw; beyond 48 there is
little to gain. The lips gain next to nothing from markers elsewhere. Fewer than 23 leave the chin to others: triangles
turn over (8 with the exponential, none with thin plate or Matérn 3/2), and the lips cross in 41 % of the frames. Which
kernel is best hardly depends on the number: the exponential and biharmonic on all moving skin from 23 on (with 63
markers thin plate has 1.76, Matérn 3/2 2.20, bi-Laplacian 1.73), and the bi-Laplacian on the lips at every number
(1.29 with 8, 0.95 with 120). Condition numbers grow slowly: exponential 26 with 23 and 55 with 120 markers.

Command: ``evalkit study run marker-count --budget full``.
"""

from __future__ import annotations

from evalkit.geometry import Array
from evalkit.studies.dense_takes import (
    DENSE_COLUMNS,
    DENSE_STATISTICS,
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
from evalkit.study.statistics import median

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
    statistics=(*DENSE_STATISTICS, median("condition", "condition number", "")),
    full=Budget(seeds=3),
    small=Budget(
        seeds=1,
        axes={"head": ("template 3000",), "markers": (8, 23, 63)},
        methods=("exponential", "biharmonic", "bilaplacian"),
    ),
)

if __name__ == "__main__":
    script(study)
