"""How fast Character Transfer is on a head, and how that grows; ratios to a workload measured in the same run."""

from __future__ import annotations

import time

import numpy as np
import pytest
import scipy.linalg
from contracts.sculpts import sculpts
from test_capture_speed import best

from evalkit.head import load_head
from evalkit.transfer.character import CharacterTransfer
from evalkit.transfer.matrices import exp_symmetric, log_positive, polar

SETUP_S, SHAPE_S, GROWTH = 0.3, 0.020, 6.0
"""What is promised for 5,000 vertices and six examples on a quiet machine, and for five times the vertices."""

QUIET_S = 0.009
"""Of :func:`reference` on the quiet machine on which the promise was made."""


def reference():
    """Work of the same kind: an array that fits no cache, products along it, and a sort."""
    a = np.random.default_rng(0).normal(size=(9, 40_000))
    for _ in range(4):
        a = a * a + 0.5
        np.sqrt(a, out=a)
    np.sort(a[0])


@pytest.fixture(scope="module")
def characters():
    """The built-in head with eyes and teeth, six examples and ten new shapes; 5,708 and 25,112 vertices."""
    heads = {count: load_head("template", vertices=count) for count in (5_000, 25_000)}
    return {count: sculpts((head.vertices, head.triangles), examples=6, new=10) for count, head in heads.items()}


def beside_reference(work, times):
    """Time, s, of work on a machine as quick as promised: by the best pair of it and the reference.

    Of the clock and not of the processor, which would count two threads of a matrix product twice.
    """
    ratios = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        middle = time.perf_counter()
        reference()
        ratios.append((middle - start) / (time.perf_counter() - middle))
    return QUIET_S * min(ratios)


@pytest.mark.timing
def test_a_shape_of_5000_vertices_takes_20_ms_after_300_ms(characters, record_property):
    made = characters[5_000]
    transfer = CharacterTransfer(*made.examples)
    setup = beside_reference(lambda: CharacterTransfer(*made.examples), 8)
    shape = beside_reference(lambda: transfer(made.new[:1]), 15)
    record_property("setup_s", setup)
    record_property("shape_s", shape)
    told = f"{len(made.rest)} vertices: set-up {setup * 1e3:.0f} ms, shape {shape * 1e3:.1f} ms"
    print(told)
    # What is promised is for 5,000 vertices; this head has 5,708.
    more = len(made.rest) / 5_000
    assert setup < SETUP_S * more and shape < SHAPE_S * more, told


@pytest.mark.timing
def test_five_times_the_vertices_take_at_most_six_times_as_long(characters, record_property):
    small, large = characters[5_000], characters[25_000]
    pairs = []
    transfers = [CharacterTransfer(*made.examples) for made in (small, large)]
    for _ in range(3):
        pairs.append([best(lambda t=t, m=m: t(m.new), 2) for t, m in zip(transfers, (small, large), strict=True)])
    ratio = min(b / a for a, b in pairs)
    record_property("ratio", ratio)
    told = f"{len(small.rest)} and {len(large.rest)} vertices: {ratio:.2f} times as long"
    print(told)
    # What is promised is for five times the vertices; the head has a few more or less.
    assert ratio < GROWTH * (len(large.rest) / len(small.rest)) / 5.0, told


@pytest.mark.timing
def test_ten_thousand_matrices_at_once_are_faster_than_a_loop(record_property):
    rng = np.random.default_rng(0)
    m = np.eye(3)[..., None] + 0.3 * rng.normal(size=(3, 3, 10_000))
    s = exp_symmetric(0.5 * (m + m.swapaxes(0, 1)))
    sample = 300
    loops = {
        "polar": (lambda: polar(m), lambda: [scipy.linalg.polar(m[..., n]) for n in range(sample)], 10.0),
        "log": (lambda: log_positive(s), lambda: [scipy.linalg.logm(s[..., n]) for n in range(sample)], 100.0),
        "exp": (lambda: exp_symmetric(m), lambda: [scipy.linalg.expm(m[..., n]) for n in range(sample)], 20.0),
    }
    for name, (many, loop, least) in loops.items():
        ours, theirs = best(many, 5), best(loop, 2) * m.shape[2] / sample
        record_property(name, theirs / ours)
        print(f"{name}: loop {theirs * 1e3:.0f} ms, at once {ours * 1e3:.1f} ms, {theirs / ours:.0f} times")
        assert theirs / ours > least, (name, theirs, ours)
