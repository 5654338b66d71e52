"""Numbers and statuses as a reader wants them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from evalkit.compensation import Compensation
from evalkit.errors import FrameStatus

NOT_OBSERVABLE = "not observable"
NO_NUMBER = "–"

PIVOT_MEANING = {
    "ok": "The motion shows where the head turns.",
    "poorly-observable": "The motion shows only roughly where the head turns; take the pivot as a guess with the "
    "uncertainty given, and turn the head further in the next take.",
    "unobservable": "The motion cannot show the pivot along at least one axis. Along it the middle of the rigid "
    "markers is shown, which is a convention and not an estimate.",
    "not-converged": "The search for the pivot stopped before it settled; try another pivot method.",
}


def number(value: Any, digits: int = 3) -> str:
    """A measure with as many digits as it can bear; infinite: not observable; NaN: a dash."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NO_NUMBER
    value = float(value)
    if math.isinf(value):
        return NOT_OBSERVABLE
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    return f"{value:,.{min(max(digits - 1 - size, 0), 4)}f}".replace("-", "−")


def coordinate(value: float) -> str:
    """A position in mm, to a tenth."""
    return f"{value:,.1f}".replace("-", "−") if np.isfinite(value) else NO_NUMBER


def headline(result: Compensation, body: bool) -> str:
    """What was done, in a sentence; ``body``: the take shows more than a head."""
    ok = int((result.frame_status == FrameStatus.OK).sum())
    frames = result.capture.frames
    part = f"all {frames:,} frames" if ok == frames else f"{ok:,} of {frames:,} frames ({ok / frames:.0%})"
    markers = "markers, weighted by how their skin moves," if result.chosen.weighted else "rigid markers"
    return (
        f"The head's motion was estimated from {len(result.rigid)} {markers} and taken out of {part}; "
        f"what remains is motion {'relative to the head' if body else 'of the face'}."
    )


def smoothing_words(result: Compensation) -> str:
    """What smoothing did to the rotations."""
    done = result.smoothing
    if done is None:
        return "none"
    return (
        f"acceleration of {number(done.acceleration_deg_s2)} deg/s² rms per axis allowed; predicted rotation error "
        f"{number(done.measured_deg)} → {number(done.smoothed_deg)} deg rms"
    )


def sway_words(result: Compensation) -> str:
    """What the translation was allowed to be, and what follows for the role of the pivot."""
    if result.sway_used == "per-frame":
        return (
            "every frame keeps its own translation, so the pivot does not enter the compensation; "
            "the pivot only splits the motion into turning and sway"
        )
    if result.sway_used == "none":
        return "the pivot is held still; the head turns about it"
    return f"the pivot's displacement is a cubic B-spline with a knot every {result.sway_used:.2g} s"
