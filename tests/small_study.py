"""A study small enough for tests: means of random numbers, with methods that fail in known ways.

Run as a script it measures the study: ``python small_study.py FOLDER JOBS``.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.seeds import generator
from evalkit.study.description import Budget, Study
from evalkit.study.statistics import efficiency, mean, relative_to, root_mean_square


def prepare(seed, size, place):
    if place == "nowhere":
        raise EvalkitError("nowhere has no data")
    return generator("small", place, size, seed=seed).standard_normal((size, 40))


def run(data, method):
    time.sleep(float(os.environ.get("SMALL_STUDY_SLEEP", "0")))
    if method == "refuses":
        raise EvalkitError("refuses to answer")
    if method == "breaks":
        return [][0]
    if method == "dies" or _dies_once():
        os.kill(os.getpid(), signal.SIGKILL)
    if method == "first":
        return data[0]
    # A product large enough for threads, if they were allowed, to sum in another order.
    return (data.T @ np.ones((len(data), 1)))[:, 0] / len(data)


def _dies_once():
    """Whether this process is the one that has to die: the first to take the token away."""
    token = os.environ.get("SMALL_STUDY_TOKEN")
    try:
        Path(token).unlink()
    except (OSError, TypeError):
        return False
    return True


def score(data, result):
    return {
        "error": float(np.sqrt((result**2).mean())),
        "bound": 1.0 / np.sqrt(len(data)),
        "word": "big" if len(data) > 20 else "small",
        "process": os.getpid(),
    }


study = Study(
    name="small",
    question="does the mean beat the first value?",
    finding="Yes.",
    axes={"size": (10, 90), "place": ("here", "there")},
    methods=("mean", "first"),
    prepare=prepare,
    run=run,
    score=score,
    columns={"error": "rms error", "bound": "its bound", "word": "a text"},
    machine={"process": "number of the process"},
    statistics=(
        root_mean_square("error", "error", "mm"),
        efficiency("error", "bound"),
        relative_to("error", "first", "over first"),
        mean("seconds", "time", "s"),
    ),
    full=Budget(seeds=5),
    small=Budget(seeds=2, axes={"size": (10,)}),
)

if __name__ == "__main__":
    from evalkit.study.runner import run as run_study

    run_study(study, Path(sys.argv[1]), jobs=int(sys.argv[2]))
