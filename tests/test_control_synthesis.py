"""Synthesis: weights against plain versions, exactness where there is an answer, and controls that must fail."""

from __future__ import annotations

import numpy as np
import pytest
from control_data import database, performed
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.control_oracles import inverse_distance_slow

from evalkit.control.search import searchers
from evalkit.control.signal_windows import Layout, SignalStatus
from evalkit.control.synthesis import MAP_RIDGE, Synthesis, linear_map, synthesise, synthesisers
from evalkit.errors import EvalkitError
from evalkit.seeds import generator

quick = settings(derandomize=True, deadline=None, max_examples=12, database=None)
WINDOW = 6
LAYOUT = Layout(window=WINDOW, latency=3, blend=4)


@pytest.fixture(scope="module")
def base():
    return database()


@pytest.fixture(scope="module")
def search(base):
    return searchers["exact"](base.parameters, base.segments, WINDOW)


def rms(values):
    return float(np.sqrt((values**2).mean()))


@pytest.mark.parametrize("name", synthesisers)
@quick
@given(seed=st.integers(0, 10_000), count=st.integers(1, 12))
def test_weights_add_up_to_one_and_do_not_hang_on_the_order(name, seed, count):
    random = generator("weights", seed=seed)
    windows, examples = random.normal(size=(3, 8)), random.normal(size=(3, count, 8))
    weights = synthesisers[name].weights(windows, examples)
    assert np.allclose(weights.sum(axis=1), 1.0, rtol=0, atol=1e-9)
    order = random.permutation(count)
    # An eigendecomposition of rows in another order: some hundred roundings of numbers of order 1.
    assert np.allclose(synthesisers[name].weights(windows, examples[:, order]), weights[:, order], rtol=0, atol=1e-7)


@quick
@given(st.integers(0, 10_000), st.integers(2, 12))
def test_inverse_distance_is_that_of_the_formula(seed, count):
    random = generator("weights", seed=seed)
    windows, examples = random.normal(size=(2, 8)), random.normal(size=(2, count, 8))
    for window, near, weights in zip(
        windows, examples, synthesisers["inverse distance"].weights(windows, examples), strict=True
    ):
        assert np.allclose(weights, inverse_distance_slow(window, near), rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", synthesisers)
def test_motion_of_the_database_comes_back(base, search, name):
    part = slice(400, 460)
    synthesis = Synthesis(base, search, WINDOW, synthesiser=name, examples=10)
    found, status = synthesise(base.parameters[part], synthesis, LAYOUT)
    assert (status == SignalStatus.OK).all()
    error = rms(found[WINDOW:] - base.motions[part][WINDOW:]) / rms(base.motions[part])
    # The window itself is among the examples: those that weigh by distance give it nearly all, a regression and the
    # Gaussian spread over ten neighbours a frame apart, which move by some per cent.
    assert error < (1e-3 if "inverse" in name or name == "nearest" else 0.05)


@pytest.mark.parametrize("name", synthesisers)
def test_another_performance_is_followed_and_random_windows_are_not(base, search, name):
    parameters, truth = performed(30, 150)
    synthesis = Synthesis(base, search, WINDOW, synthesiser=name)
    found, _ = synthesise(parameters, synthesis, LAYOUT)
    # Four numbers drive this face and an hour of it could not fill four dimensions: half of the motion is no high bar,
    # and the control is far above it.
    assert rms(found - truth) < 0.5 * rms(truth)

    class Blind:
        def nearest(self, queries, k):
            return np.ones((len(queries), k)), generator("blind").integers(0, 1000, (len(queries), k))

    # A linear fit to windows anywhere does well on a face that is nearly linear: only distances need the search.
    if "components" not in name and not synthesisers[name].corrected:
        blind, _ = synthesise(parameters, Synthesis(base, Blind(), WINDOW, synthesiser=name), LAYOUT)
        assert rms(blind - truth) > 0.5 * rms(truth)


def test_the_linear_map_is_exact_for_markers_that_are_linear_in_the_parameters():
    base = database(rows=400)
    wanted = generator("map").normal(size=(15, 21))
    base.motions = (base.parameters @ wanted).reshape(-1, 7, 3).astype(np.float32)
    search = searchers["exact"](base.parameters, base.segments, WINDOW)
    parameters = performed(30, 60)[0]
    synthesis = Synthesis(base, search, WINDOW, synthesiser="corrected inverse distance")
    found, _ = synthesise(parameters, synthesis, Layout(window=WINDOW, latency=0))
    error = rms(found.reshape(60, -1) - parameters @ wanted) / rms(parameters @ wanted)
    # A ridge of a hundredth of the variance takes as much of the directions that matter, of what examples leave.
    assert error < 2 * MAP_RIDGE
    # The control: the examples alone.
    alone = Synthesis(base, search, WINDOW, synthesiser="inverse distance")
    found, _ = synthesise(parameters, alone, Layout(window=WINDOW, latency=0))
    assert rms(found.reshape(60, -1) - parameters @ wanted) / rms(parameters @ wanted) > 10 * MAP_RIDGE


def test_the_linear_map_is_not_followed_beyond_the_database(base):
    line = linear_map(base, np.arange(15))
    rows = base.parameters[::7].astype(np.float64)
    within = line.within(rows)
    same = np.abs(within - rows).max(axis=1) < 1e-9  # of numbers of order 1, rounding alone
    # All but the thousandth that is furthest out, and some luck of every seventh row.
    assert same.mean() > 0.995
    far = line.within(line.mean + 100.0 * (rows - line.mean)) - line.mean
    assert np.sqrt(((far @ line.precision) * far).sum(axis=1)).max() == pytest.approx(line.limit)


def test_frames_with_a_hole_are_lost(base, search):
    signal = performed(30, 40)[0]
    signal[10:12, 3] = np.nan
    found, status = synthesise(signal, Synthesis(base, search, WINDOW), LAYOUT)
    assert np.flatnonzero(status == SignalStatus.LOST).tolist() == [10, 11]
    assert np.isnan(found[10:12]).all()
    assert np.isfinite(np.delete(found, [10, 11], axis=0)).all()


@pytest.mark.parametrize("ratio", [0.5, 0.75, 2.0, 2.5])
def test_a_signal_at_another_rate_moves_the_markers_alike(base, search, ratio):
    parameters, truth = performed(30, 80, rate_hz=60.0 / ratio)
    layout = Layout(window=WINDOW, latency=2, blend=4, ratio=ratio)
    found, _ = synthesise(parameters, Synthesis(base, search, WINDOW), layout)
    # The markers are linear in four numbers that the parameters tell: what is left is the ridge.
    assert rms(found - truth) < 2 * MAP_RIDGE * rms(truth)
    weighted = Synthesis(base, search, WINDOW, synthesiser="inverse distance")
    right = rms(synthesise(parameters, weighted, layout)[0] - truth)
    wrong = rms(synthesise(parameters, weighted, Layout(window=WINDOW, latency=2, blend=4))[0] - truth)
    # The control: taken for the database's own rate, a slow signal looks quick, and finds what is nowhere.
    assert right < 0.9 * wrong or ratio < 1.0


def test_mistakes_are_one_line(base, search):
    for wrong, words in (({"synthesiser": "magic"}, "known are inverse distance"), ({"examples": 0}, "use 1 or more")):
        with pytest.raises(EvalkitError, match=words):
            Synthesis(base, search, WINDOW, **wrong)
    with pytest.raises(EvalkitError, match="one column a parameter"):
        synthesise(np.zeros((5, 3)), Synthesis(base, search, WINDOW), LAYOUT)
