"""Treatments of the seam between the fields of face, upper lip and lower lip.

Question: what jump does each treatment of the seam leave beside the mouth corners, and what does it cost the lips?

Finding: with 5 seeds, largest jump across an edge beside the mouth corners, mm, at the default resolution:
exponential hard 3.0, ramp 0.010, spline 0.48, one field for all 0.013; thin plate hard 7.5, ramp 0.019, spline 0.91;
bi-Laplacian hard 3.5, ramp 0.049, spline 1.7, but there one field without any seam has 0.30, from the kinks at its
markers. The ramp keeps to the target of 0.05 mm with all three, the bi-Laplacian only just, and costs the lips a tenth:
exponential 1.14 mm against 1.04 with a hard seam and 2.17 without regions. The spline is the best on the lips with the
thin plate (1.24 against 1.44) and leaves a visible seam. With 3,000 vertices, edges of 5 mm, the ramp is only two or
three edges wide: 0.040 mm with the exponential, 0.33 mm with the thin plate, 0.34 mm with the bi-Laplacian (none: 1.7).

Command: ``evalkit study run regions --budget full``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from evalkit.deform import Deformer, seam_jump, seam_treatments
from evalkit.geometry import Array
from evalkit.studies.dense_takes import (
    DENSE_COLUMNS,
    DENSE_STATISTICS,
    FLIP_STEP,
    DenseTake,
    build_map,
    dense_take,
    score_map,
)
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.statistics import largest


def prepare(seed: int, head: str, kernel: str) -> tuple[DenseTake, str]:
    """A performance seen by the 23 markers, and the kernel."""
    return dense_take(head, seed), kernel


def run(data: tuple[DenseTake, str], method: str) -> tuple[Array, float]:
    """The map with this treatment of the seam."""
    take, kernel = data
    return build_map(take, kernel, seam=method)


def score(data: tuple[DenseTake, str], result: tuple[Array, float]) -> dict[str, Any]:
    """Errors, and the jump of the outer skin in every fifth frame."""
    take, head = data[0], data[0].face.head
    moved = Deformer(result[0])(take.displacement[::FLIP_STEP])
    outer = {name: np.intersect1d(which, head.skin_vertices) for name, which in head.regions.items()}
    head = replace(head, regions=outer)
    return {**score_map(take, result), "jump_mm": float(seam_jump(head, moved).max(initial=0.0))}


QUESTION, FINDING = told(__doc__)

study = Study(
    name="regions",
    question=QUESTION,
    finding=FINDING,
    axes={"head": ("template", "template 3000"), "kernel": ("exponential", "thin-plate", "bilaplacian")},
    methods=tuple(seam_treatments),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        **DENSE_COLUMNS,
        "jump_mm": "largest evalkit.deform.seam_jump of the outer skin beside the mouth corners, mm",
    },
    statistics=(largest("jump_mm", "jump at the corners", "mm"), *DENSE_STATISTICS),
    full=Budget(seeds=5),
    small=Budget(seeds=1, axes={"head": ("template 3000",), "kernel": ("exponential", "thin-plate")}),
    # The target for a seam that nobody sees, at the default resolution; a hard one jumps by a hundred times as much.
    expected=(Expected("jump at the corners", "ramp", 0.05, where={"head": "template"}),),
)

if __name__ == "__main__":
    script(study)
