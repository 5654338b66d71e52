"""Kernels of the deformation map, with and without regions for the lips.

Question: what do the kernel, and which vertices listen to which markers, matter for the error of all vertices?

Finding: -

Command: ``evalkit study run rbf-kernels --budget full``; other heads by ``--axis head=ict`` or ``--axis head=PATH``.
"""

from __future__ import annotations

from evalkit.geometry import Array
from evalkit.studies.dense_takes import (
    DENSE_COLUMNS,
    DENSE_FIGURES,
    KERNELS,
    STILL,
    DenseTake,
    build_map,
    dense_take,
    score_map,
)
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.figures import median, relative_to, root_mean_square

WITHOUT = " alone"
"""At the end of a method: one field for all vertices, no regions."""


def prepare(seed: int, head: str, noise_mm: float) -> DenseTake:
    """A performance seen by the 23 markers."""
    return dense_take(head, seed, noise_mm)


def run(data: DenseTake, method: str) -> tuple[Array, float]:
    """The map of a kernel, with regions or without."""
    return build_map(data, method.removesuffix(WITHOUT), regions=not method.endswith(WITHOUT))


QUESTION, FINDING = told(__doc__)

study = Study(
    name="rbf-kernels",
    question=QUESTION,
    finding=FINDING,
    axes={"head": ("template",), "noise_mm": (0.0, 0.5)},
    methods=(STILL, *(name + end for name in KERNELS for end in ("", WITHOUT))),
    prepare=prepare,
    run=run,
    score=score_map,
    columns=DENSE_COLUMNS,
    figures=(
        *DENSE_FIGURES,
        root_mean_square("inside_mm", "inside the mouth", "mm"),
        relative_to("lips_mm", "exponential", "lips over the paper's kernel"),
        relative_to("all_mm", "exponential", "all over the paper's kernel"),
        median("condition", "condition number", ""),
    ),
    full=Budget(seeds=5),
    small=Budget(seeds=1, axes={"head": ("template 3000",), "noise_mm": (0.0,)}),
    expected=(
        # A map that were no better than a face at rest would have its lips at about 2.5 times the paper's.
        Expected("lips over the paper's kernel", "exponential" + WITHOUT, 1.0, least=True, where={"noise_mm": 0.0}),
    ),
)

if __name__ == "__main__":
    script(study)
