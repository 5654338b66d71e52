"""The data-driven filter: against plain versions, with gaps, and what it is worth on motion with noise."""

from __future__ import annotations

import numpy as np
import pytest
from control_data import database, performed
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.control_oracles import cross_blended, posterior_slow, projected_slow

from evalkit.control.filtering import (
    NOISE_FLOOR,
    LocalFilter,
    WindowPrior,
    even,
    filter_parameters,
    local_plane,
    methods,
    noise_variance,
    on_plane,
)
from evalkit.control.search import searchers
from evalkit.control.signal_windows import Layout, SignalStatus, anchored, over_windows
from evalkit.errors import EvalkitError
from evalkit.seeds import generator

quick = settings(derandomize=True, deadline=None, max_examples=12, database=None)
WINDOW = 8
ROUND_OFF = 1e-9
"""Numbers of order 1 through an eigendecomposition of a matrix of inner products, which halves the digits of the
smallest directions that 99 % of the variance keeps: 1e-16 over 1e-2, with room for some hundred terms."""


@pytest.fixture(scope="module")
def base():
    return database()


@pytest.fixture(scope="module")
def search(base):
    return searchers["exact"](base.parameters, base.segments, WINDOW)


def rms(values):
    return float(np.sqrt((values**2).mean()))


@quick
@given(st.integers(0, 10_000), st.integers(3, 20), st.integers(2, 30), st.sampled_from([0.9, 0.99]))
def test_projection_is_that_of_the_singular_vectors(seed, count, dimensions, kept):
    random = generator("projection", seed=seed)
    neighbours = random.normal(size=(3, count, dimensions)) * random.uniform(0.2, 3.0, dimensions)
    windows = random.normal(size=(3, dimensions))
    weights = on_plane(local_plane(neighbours, even(np.ones((3, count))), kept), neighbours, windows)
    assert np.allclose(weights.sum(axis=1), 1.0, rtol=0, atol=ROUND_OFF)
    for window, near, weight in zip(windows, neighbours, weights, strict=True):
        assert np.allclose(weight @ near, projected_slow(window, near, kept), rtol=0, atol=ROUND_OFF)


def test_neighbours_that_are_all_the_same_are_what_comes_out():
    same = np.ones((1, 5, 6))
    weights = on_plane(local_plane(same, even(np.ones((1, 5)))), same, np.full((1, 6), 3.0))
    assert np.allclose(weights @ same[0], 1.0, rtol=0, atol=ROUND_OFF)


@quick
@given(st.integers(0, 10_000), st.floats(0.0, 0.6))
def test_posterior_is_the_gaussian_given_what_is_known(base, seed, gaps):
    random = generator("posterior", seed=seed)
    prior = WindowPrior.of(base, 4, np.arange(15))
    assert prior.rest > NOISE_FLOOR
    windows = random.normal(size=(2, 60))
    windows[random.random(windows.shape) < gaps] = np.nan
    noise = random.uniform(0.05, 1.0, windows.shape)
    covariance = (prior.axes * prior.variances) @ prior.axes.T
    for window, level, found in zip(windows, noise + prior.rest, prior.posterior(windows, noise), strict=True):
        assert np.allclose(found, posterior_slow(window, prior.mean, covariance, level), rtol=0, atol=ROUND_OFF)


def test_noise_is_told_from_motion():
    clean = performed(9, 400)[0].reshape(-1, 20, 15)
    noisy = clean + 0.3 * generator("noise").standard_normal(clean.shape)
    # 20 windows of 17 third differences each: the variance is known to about 10 %; motion at 60 Hz adds nothing.
    assert noise_variance(noisy).mean() == pytest.approx(0.09, rel=0.1)
    assert noise_variance(clean).mean() < 1e-5
    noisy[:, :, 3] = np.nan
    found = noise_variance(noisy)
    # All others have as many differences: the same sum in another order.
    assert np.allclose(found[:, 3], np.delete(found, 3, axis=1).mean(axis=1), rtol=1e-12, atol=0)


@pytest.mark.parametrize("method", methods)
def test_every_filter_halves_the_noise_of_motion_in_the_database(base, search, method):
    clean = base.parameters[300:420].astype(np.float64)
    noisy = clean + 0.3 * generator("noise", method).standard_normal(clean.shape)
    found, status = filter_parameters(noisy, LocalFilter(base, search, WINDOW, method=method), Layout(window=WINDOW))
    assert (status == SignalStatus.OK).all()
    # The bound of the specification.
    assert rms(found - clean) <= 0.5 * rms(noisy - clean)


def test_a_database_of_something_else_does_not(base):
    """The control: shuffled in time, its windows are no motion, and the projection pulls away from the truth."""
    order = generator("shuffle").permutation(len(base.parameters))
    other = database()
    other.parameters = base.parameters[order]
    clean = base.parameters[300:360].astype(np.float64)
    noisy = clean + 0.3 * generator("noise").standard_normal(clean.shape)
    search = searchers["exact"](other.parameters, other.segments, WINDOW)
    found, _ = filter_parameters(noisy, LocalFilter(other, search, WINDOW, method="projection"), Layout(window=WINDOW))
    assert rms(found - clean) > 0.5 * rms(noisy - clean)


def test_projection_takes_away_what_the_database_does_not_have_and_the_posterior_little(base, search):
    strange = performed(50, 120)[0]
    strange[:, 4] += 2.0 * np.sin(np.arange(120) / 12.0)
    error = {
        method: rms(
            filter_parameters(strange, LocalFilter(base, search, WINDOW, method=method), Layout(window=WINDOW))[0]
            - strange
        )
        for method in ("projection", "posterior")
    }
    assert error["posterior"] < 0.5 * error["projection"]


@pytest.mark.parametrize("method", methods)
def test_missing_parameters_are_filled_in_from_the_database(base, search, method):
    clean = base.parameters[300:400].astype(np.float64)
    signal = clean.copy()
    signal[30:, 2] = np.nan
    signal[50:53] = np.nan
    signal[70:90] = np.nan
    found, status = filter_parameters(signal, LocalFilter(base, search, WINDOW, method=method), Layout(window=WINDOW))
    names = np.array([SignalStatus(value).text for value in status])
    assert set(names[:30]) == {"ok"}
    assert set(names[50:53]) == {"bridged"}
    assert set(names[70:90]) == {"lost"}
    assert set(names[[30, 49, 53, 69, 90, 99]]) == {"filled"}
    assert np.isnan(found[70:90]).all()
    assert np.isfinite(found[names != "lost"]).all()
    filled = found[30:70, 2] - clean[30:70, 2]
    # The others drive the same face: the missing one follows, with less than half of its own size of error.
    assert rms(filled) < 0.5 * rms(clean[30:70, 2])


def test_what_shares_a_batch_with_gaps_does_not_change(base, search):
    clean = base.parameters[300:340].astype(np.float64)
    local = LocalFilter(base, search, WINDOW, method="projection")
    gaps = clean.copy()
    gaps[30:, 1] = np.nan
    one, other = (filter_parameters(signal, local, Layout(window=WINDOW))[0] for signal in (clean, gaps))
    assert np.array_equal(one[:26], other[:26])


def test_parameters_that_the_database_does_not_know_stay_unknown():
    base = database(unknown=(3, 7))
    columns = np.flatnonzero(base.known)
    search = searchers["exact"](base.parameters[:, columns], base.segments, WINDOW)
    found, _ = filter_parameters(performed(4, 60)[0], LocalFilter(base, search, WINDOW), Layout(window=WINDOW))
    assert np.isnan(found[:, [3, 7]]).all()
    assert np.isfinite(found[:, columns]).all()


@quick
@given(st.integers(6, 15), st.integers(1, 5), st.integers(0, 1000))
def test_segments_are_blended_as_in_the_paper(width, blend, seed):
    blend = min(blend, width // 2)
    step = width - blend
    values = generator("blend", seed=seed).normal(size=(4, width))
    numbers = iter(range(4))

    def answer(windows):
        return np.stack([values[next(numbers)] for _ in windows])[..., None]

    layout = Layout(window=width, latency=width - 1, blend=blend, step=step)
    # The first window ends with the first step; what it has before the signal began is not read.
    frames = 4 * step
    found = over_windows(np.zeros((frames, 1)), layout, answer)[0][:, 0]
    assert np.allclose(found, cross_blended(values, step, blend)[blend:], rtol=0, atol=1e-12)


@quick
@given(st.lists(st.booleans(), min_size=1, max_size=40), st.integers(0, 4))
def test_anchors_follow_the_rule_one_frame_at_a_time(lost, bridge):
    expected, anchor, last = [], -1, None
    for frame, gone in enumerate(lost):
        if gone:
            expected.append(-1)
            continue
        if last is None or frame - last - 1 > bridge:
            anchor = frame
        last = frame
        expected.append(anchor)
    assert anchored(np.array(lost), bridge).tolist() == expected


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"window": 1}, "at least 2"),
        ({"latency": 12}, "use 0 to 9"),
        ({"latency": 4, "ratio": 3.0}, "use 0 to 3"),
        ({"step": 9}, "without one"),
        ({"blend": 10}, "blend must be 1 to 9"),
        ({"ratio": 0.0}, "> 0"),
    ],
)
def test_layouts_that_make_no_sense_are_refused(wrong, words):
    with pytest.raises(EvalkitError, match=words):
        Layout(**wrong)


def test_mistakes_are_one_line(base, search):
    for wrong, words in (
        ({"method": "magic"}, "known are projection"),
        ({"neighbours": 1}, "make no plane"),
        ({"kept": 1.5}, "not a share"),
    ):
        with pytest.raises(EvalkitError, match=words):
            LocalFilter(base, search, WINDOW, **wrong)
    local = LocalFilter(base, search, WINDOW)
    for signal, words in (
        (np.zeros((5, 14)), r"expected \(frames, 15\)"),
        (np.zeros((0, 15)), "no frames"),
        (np.full((5, 15), np.nan), "was the face found"),
    ):
        with pytest.raises(EvalkitError, match=words):
            filter_parameters(signal, local, Layout(window=WINDOW))
