"""Centres that never move, on the rear of the head and the neck.

Question: how many static centres keep the rim of the mask still, and what do they do to the face?

Finding: with 5 seeds and the exponential, drift of the rim without static centres / with 5, 10, 20 and 40 of them,
rms mm: 10.9 / 1.91, 0.98, 0.20, 0.06; biharmonic 10.9 / 1.79, 0.69, 0.14, 0.05; bi-Laplacian 4.6 / 2.2, 0.91, 0.24,
0.09. Without any, the motion of the jaw reaches the back of the head, and the face itself errs by 4.25 mm. The face
is best with 10, 2.11 mm, and not with 20, 2.41 mm: with more of them some come near the jaw, where skin should move.
The lips, with markers of their own and no static centres, do not change. Twenty are right where the rim of the mask
is seen, ten where the face is what counts.

Command: ``evalkit study run static-points --budget full``.
"""

from __future__ import annotations

import numpy as np

from evalkit.deform.surface import spread_out
from evalkit.geometry import Array
from evalkit.studies.dense_takes import DENSE_COLUMNS, DENSE_STATISTICS, DenseTake, build_map, dense_take, score_map
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.statistics import root_mean_square

SHARE = 0.6
"""Share of the static centres that is on the hindbrain; the others are on the neck."""


def prepare(seed: int, head: str, static: int) -> tuple[DenseTake, Array]:
    """A performance, and the places of so many static centres, spread out over hindbrain and neck."""
    take = dense_take(head, seed)
    regions, vertices = take.face.head.regions, take.face.head.vertices
    count = {"hindbrain": round(SHARE * static)}
    count["neck"] = static - count["hindbrain"]
    chosen = [regions[name][spread_out(vertices[regions[name]], k)] for name, k in count.items()]
    return take, vertices[np.concatenate(chosen)]


def run(data: tuple[DenseTake, Array], method: str) -> tuple[Array, float]:
    """The map of a kernel with these static centres."""
    take, static = data
    return build_map(take, method, static=static)


QUESTION, FINDING = told(__doc__)

study = Study(
    name="static-points",
    question=QUESTION,
    finding=FINDING,
    axes={"head": ("template",), "static": (0, 5, 10, 20, 40)},
    methods=("exponential", "biharmonic", "matern-3-2", "bilaplacian"),
    prepare=prepare,
    run=run,
    score=lambda data, result: score_map(data[0], result),
    columns=DENSE_COLUMNS,
    statistics=(root_mean_square("rim_mm", "drift of the rim", "mm"), *DENSE_STATISTICS),
    full=Budget(seeds=5),
    small=Budget(seeds=1, axes={"head": ("template 3000",), "static": (0, 20)}),
    # What the eye does not see at the rim of a mask: a tenth of what the markers err.
    expected=(Expected("drift of the rim", "exponential", 0.5, where={"static": 20}),),
)

if __name__ == "__main__":
    script(study)
