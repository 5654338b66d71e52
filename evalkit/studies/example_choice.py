"""Which expressions the artist should sculpt.

Question: given only the rough shapes, does choosing the examples beat drawing them at random?

An artist who sculpts k expressions has those exactly and gets all others made: what counts is the error of the whole
set. Errors of what neither way has sculpted are told beside it, since choosing what moves most leaves what is easy.

Finding: with the small budget so far (1 of the 3 seeds, template, the paper's method): with two examples the
automatic choice is 9 % worse than a random draw, with four 8 % better, over the whole set.

Command: ``evalkit study run example-choice --budget full``.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from evalkit.dense import Character
from evalkit.dense.two_artists import DIRECTIONS
from evalkit.geometry import Array
from evalkit.head.model import Indices
from evalkit.seeds import generator
from evalkit.studies.takes import told
from evalkit.studies.transfers import (
    EYES_CM,
    Task,
    acted_by,
    over,
    rms_mm,
    run_method,
    where_present,
)
from evalkit.study.command import script
from evalkit.study.description import Budget, Expected, Study
from evalkit.study.statistics import mean, relative_to
from evalkit.transfer.choosing import choose_examples

CHOSEN, RANDOM = "chosen", "random"
MOST = 16


class Choice(NamedTuple):
    """A character, the method that makes the others, and what to sculpt, drawn at random and chosen."""

    one: Character
    transfer: str
    drawn: Indices
    chosen: Indices


class Set(NamedTuple):
    """Which expressions were sculpted, and all expressions (N, V, 3), those as sculpted."""

    sculpted: Indices
    shapes: Array


def prepare(seed: int, character: str, transfer: str, examples: int) -> Choice:
    """A character, a random draw, to which more examples are added, and what the rough shapes alone say."""
    one = acted_by(character, seed)
    order = generator("training expressions", one.name, seed=seed).permutation(len(one.names))
    return Choice(one, transfer, order[:examples], _chosen(character, seed)[:examples])


@lru_cache(maxsize=8)
def _chosen(character: str, seed: int) -> Indices:
    """As many as are asked for at most: the order does not depend on how many."""
    one = acted_by(character, seed)
    return choose_examples(one.rest, one.rough, one.triangles, MOST)


def run(data: Choice, method: str) -> Set:
    """All expressions, with examples chosen or drawn."""
    sculpted = data.chosen if method == CHOSEN else data.drawn
    task = Task(data.one, sculpted, np.setdiff1d(np.arange(len(data.one.names)), sculpted))
    shapes = data.one.fine.copy()
    shapes[task.new] = run_method(task, data.transfer)
    return Set(sculpted, shapes)


def score(data: Choice, found: Set) -> dict[str, Any]:
    """Errors of the whole set, and of what neither way has sculpted."""
    one = data.one
    errors, rough = found.shapes - one.fine, one.rough - one.fine
    others = np.setdiff1d(np.arange(len(one.names)), found.sculpted)
    neither = np.setdiff1d(np.arange(len(one.names)), np.union1d(data.chosen, data.drawn))
    whole = rms_mm(errors)
    return {
        "whole_cm": None if whole is None else EYES_CM * whole / one.eye_distance_mm,
        "whole_ratio": over(whole, rms_mm(rough)),
        "others_ratio": over(rms_mm(errors[others]), rms_mm(rough[others])),
        "neither_cm": over(rms_mm(errors[neither]), one.eye_distance_mm / EYES_CM),
        "sculpted": ", ".join(one.names[k] for k in found.sculpted),
    }


QUESTION, FINDING = told(__doc__)

study = Study(
    name="example-choice",
    question=QUESTION,
    finding=FINDING,
    axes={
        "character": ("template", *DIRECTIONS),
        "transfer": ("gain", "position deltas of one region", "character transfer", "local regression"),
        "examples": (4, 8, 16),
    },
    methods=(RANDOM, CHOSEN),
    prepare=prepare,
    run=run,
    score=score,
    columns={
        "whole_cm": "sqrt(mean |x - x_sculpt|^2) over all vertices of all expressions, the sculpted ones exact, cm "
        "where the inner corners of the eyes are 50 cm apart",
        "whole_ratio": "whole_cm over that of the rough shapes, none of them sculpted",
        "others_ratio": "the same ratio over the expressions that this way has not sculpted",
        "neither_cm": "the same error over the expressions that neither way has sculpted, cm",
        "sculpted": "names of the examples",
    },
    statistics=(
        mean("whole_cm", "whole set", "cm"),
        mean("whole_ratio", "whole set over rough", ""),
        relative_to("whole_cm", RANDOM, "whole set over random"),
        mean("others_ratio", "others over rough", ""),
        relative_to("neither_cm", RANDOM, "unsculpted by both over random"),
    ),
    full=Budget(seeds=3),
    small=Budget(
        seeds=1, axes={"character": ("template",), "transfer": ("gain", "character transfer"), "examples": (4,)}
    ),
    applies=where_present(RANDOM),
    expected=(Expected("whole set over random", CHOSEN, 1.0),),
)

if __name__ == "__main__":
    script(study)
