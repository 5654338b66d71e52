"""Control frame by frame: what comes out is what comes out all at once, later; rates, lost frames, speed."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from control_data import MARKERS, database, performed
from hypothesis import given, settings
from hypothesis import strategies as st

from evalkit.control.signal_windows import Layout, SignalStatus
from evalkit.control.stream import PAPER, Control, Settings
from evalkit.errors import EvalkitError
from evalkit.seeds import generator
from evalkit.vision.parameters import NAMES

ROUND_OFF = 1e-7
"""One window or 64 in one product of matrices sum in another order: 1e-16, over a system whose condition is the ratio
of the prior's variances and the least noise, up to 1e6; displacements are some millimetres."""

KINDS = {
    "usual": Settings(layout=Layout(window=8)),
    "local": Settings(layout=Layout(window=8), method="local posterior", neighbours=20),
    "at once": Settings(layout=Layout(window=8, latency=0)),
    "segments": replace(PAPER, searcher="exact", neighbours=20),
    "graph": replace(PAPER, neighbours=20, layout=Layout(window=8, latency=7, step=3)),
}


@pytest.fixture(scope="module")
def base():
    return database(rows=300)


def stepped(control, signal):
    """Frames out of a stream, and after how many frames in each came."""
    out = []
    for number, row in enumerate(signal):
        found = control.step(row)
        if found is not None:
            assert found.frame == number - control.layout.latency
            out.append(found)
    return out + control.finish()


def with_faults(signal, seed):
    random = generator("faults", seed=seed)
    signal = signal.copy()
    signal[random.random(signal.shape) < 0.05] = np.nan
    begin, length = random.integers(0, len(signal), 3), random.integers(1, 12, 3)
    for first, count in zip(begin, length, strict=True):
        signal[first : first + count] = np.nan
    return signal


@pytest.mark.parametrize("kind", KINDS)
@settings(derandomize=True, deadline=None, max_examples=3, database=None)
@given(seed=st.integers(0, 1000), rate=st.sampled_from([60.0, 30.0, 25.0, 100.0]), faulty=st.booleans())
def test_frame_by_frame_is_all_at_once(base, kind, seed, rate, faulty):
    signal = performed(seed, 45)[0]
    signal = with_faults(signal, seed) if faulty else signal
    control = _controls(base, kind, rate)
    whole = control.run(signal)
    frames = stepped(control, signal)
    assert [frame.frame for frame in frames] == list(range(45))
    assert [frame.status for frame in frames] == whole.status.tolist()
    for name in ("parameters", "displacements"):
        found = np.stack([getattr(frame, name) for frame in frames])
        assert np.allclose(found, getattr(whole, name), rtol=0, atol=ROUND_OFF, equal_nan=True)


def _controls(base, kind, rate, kept={}):  # noqa: B006 - one for each, since the graph takes its time
    if (kind, rate) not in kept:
        kept[kind, rate] = Control(base, rate, KINDS[kind])
    return kept[kind, rate]


def test_lost_frames_are_held_and_say_so(base):
    signal = performed(3, 60)[0]
    signal[:4] = np.nan
    signal[30:45] = np.nan
    found = Control(base, settings=KINDS["usual"]).run(signal)
    lost = found.status == SignalStatus.LOST
    assert np.flatnonzero(lost).tolist() == [*range(4), *range(30, 45)]
    assert np.isnan(found.displacements[:4]).all()
    assert (found.displacements[30:45] == found.displacements[29]).all()
    assert np.isnan(found.parameters[lost]).all()


def test_what_is_told_of_the_past_does_not_hang_on_the_future_beyond_the_latency(base):
    signal = performed(3, 60)[0]
    other = signal.copy()
    other[40:] += 5.0
    control = Control(base, settings=KINDS["usual"])
    one, two = control.run(signal).displacements, control.run(other).displacements
    told = 40 - control.layout.latency
    assert np.array_equal(one[:told], two[:told])
    assert not np.array_equal(one[told], two[told])


def test_a_new_signal_begins_anew(base):
    control = Control(base, settings=KINDS["usual"])
    first, second = performed(3, 30)[0], performed(4, 30)[0]
    stepped(control, first)
    again = np.stack([frame.displacements for frame in stepped(control, second)])
    fresh = np.stack([f.displacements for f in stepped(Control(base, settings=KINDS["usual"]), second)])
    assert np.array_equal(again, fresh)


def test_parameters_that_are_not_common_are_left_aside():
    base = database(rows=300, unknown=(3, 7))
    control = Control(base, given=[name for name in NAMES if name != "lip_opening"])
    assert control.unused == [NAMES[3], NAMES[7]]
    signal = performed(3, 40)[0]
    found = control.run(signal)
    assert np.isnan(found.parameters[:, [0, 3, 7]]).all()
    assert np.isfinite(found.displacements).all()
    signal[:, [0, 3, 7]] = np.nan
    assert np.array_equal(found.displacements, control.run(signal).displacements)


def test_mistakes_are_one_line(base):
    for wrong, words in (
        ({"rate_hz": 0.0}, "rate is 0.0 Hz"),
        ({"rate_hz": float("nan")}, "must be a number"),
        ({"given": ["lip_opening", "smile"]}, "'smile' is no control parameter"),
        ({"given": ["lip_opening", "eye_left"]}, "too few control parameters"),
        ({"settings": Settings(searcher="magic")}, "known are"),
        ({"settings": Settings(layout=Layout(window=400))}, "as long as a window"),
    ):
        with pytest.raises(EvalkitError, match=words) as caught:
            Control(base, **wrong)
        assert "\n" not in str(caught.value)
    with pytest.raises(EvalkitError, match="expected"):
        Control(base).step(np.zeros(14))


def test_a_frame_takes_less_than_ten_milliseconds_of_a_large_database():
    """70,000 windows of 300 numbers and 50 markers, one frame after the other, search included."""
    rows = 70_019
    base = performed(1, rows)
    big = SimpleNamespace(
        parameters=base[0].astype(np.float32), known=np.ones(15, bool), segments=np.array([[0, rows]]), rate_hz=60.0,
        motions=np.tile(base[1].astype(np.float32), (1, 50 // MARKERS + 1, 1))[:, :50],
    )  # fmt: skip
    control = Control(big, settings=Settings(layout=Layout(window=20)))
    signal = performed(2, 80)[0]
    signal += 0.1 * generator("speed").standard_normal(signal.shape)
    taken = []
    for row in signal:
        start = time.process_time()
        control.step(row)
        taken.append(time.process_time() - start)
    # The budget of the specification, in processor time: what else the machine does is not counted. The median, since
    # the first frames of a stream find nothing near.
    assert np.median(taken) < 0.010
