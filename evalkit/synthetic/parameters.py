"""What a synthetic take is made of."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from evalkit.errors import EvalkitError
from evalkit.synthetic.expression import ACTION_NAMES
from evalkit.synthetic.layouts import LAYOUTS
from evalkit.synthetic.motion import PROFILES


@dataclass(frozen=True)
class Field:
    """What one parameter is.

    Parameters
    ----------
    group : str
        Part of the take that it belongs to.
    unit : str
        Unit, empty for a plain number or a name.
    text : str
        One line on its meaning; `Parameters` says more.
    limits : (float, float), optional
        Smallest and largest value, of a number.
    """

    group: str
    unit: str
    text: str
    limits: tuple[float, float] | None = None


FIELDS: dict[str, Field] = {
    "layout": Field("performer", "", f"marker layout: {', '.join(LAYOUTS)}"),
    "performer": Field("performer", "", "0 the average face, other numbers other people", (0, 2**31)),
    "frames": Field("length", "frames", "number of frames", (1, 2_000_000)),
    "rate": Field("length", "Hz", "frames per second", (1, 10_000)),
    "range_deg": Field("head motion", "deg", "largest angle of nod,turn,tilt, or one for all; 0: still"),
    "speed": Field("head motion", "deg/s", "fastest change of posture about one axis", (1, 1000)),
    "profile": Field("head motion", "", f"speed profile: {', '.join(PROFILES)}"),
    "sway": Field("neck", "mm", "largest drift of the pivot from its mean place", (0, 1000)),
    "sway_hz": Field("neck", "Hz", "upper end of the sway's band", (0.01, 2)),
    "neck_gap_mm": Field("neck", "mm", "two joints: how far above the pivot the head nods", (-200, 200)),
    "actions": Field("face", "", "expression patterns performed"),
    "expression": Field("face", "", "strength of the expressions, 1 ordinary", (0, 3)),
    "liveliness": Field("face", "", "how often expressions come, 1 ordinary", (0.05, 20)),
    "asymmetry": Field("face", "", "one-sided smile and brows: 1 left only, -1 right only", (-1, 1)),
    "skin": Field("face", "mm", "slide of the forehead, rigid markers included", (0, 30)),
    "noise": Field("noise", "mm", "standard deviation per axis", (0, 100)),
    "noise_time_s": Field("noise", "s", "correlation time; 0: white", (0, 100)),
    "noise_shared": Field("noise", "", "part of the variance shared between neighbours", (0, 1)),
    "quantum_mm": Field("noise", "mm", "step of the coordinates' grid; 0: none", (0, 10)),
    "gaps": Field("faults", "", "share of samples missing", (0, 0.9)),
    "gap_bursts": Field("faults", "", "part of that in bursts, the rest single frames", (0, 1)),
    "gap_length": Field("faults", "frames", "mean length of a burst", (1, 10_000)),
    "outliers": Field("faults", "", "share of samples displaced", (0, 0.5)),
    "outlier_mm": Field("faults", "mm", "mean displacement, a half more or less", (0, 1000)),
    "outlier_bursts": Field("faults", "", "part in bursts of one displacement (ghosts)", (0, 1)),
    "outlier_length": Field("faults", "frames", "mean length of a burst", (1, 10_000)),
    "swaps": Field("faults", "", "share of the time that neighbours have exchanged labels", (0, 0.5)),
    "swap_length": Field("faults", "frames", "mean length of an exchange of labels", (1, 10_000)),
}
"""Parameter -> what it is, in groups."""

LARGEST_ANGLE_DEG = 90.0
"""Largest range of motion; beyond it nod, turn and tilt are no longer told apart."""

NAMED: dict[str, Collection[str]] = {"layout": LAYOUTS, "profile": PROFILES}
"""Parameters that are one of several names."""

WHOLE = ("frames", "performer", "gap_length", "outlier_length", "swap_length")
"""Fields that are whole numbers."""


@dataclass(frozen=True)
class Parameters:
    """Everything that a synthetic take depends on, besides its seed.

    Parameters
    ----------
    layout : str
        Marker layout, a name in `evalkit.synthetic.layouts.LAYOUTS`.
    performer : int
        0 is the average face; other numbers are other people.
    frames : int
        Number of frames F.
    rate : float
        Frames per second, Hz.
    range_deg : (float, float, float)
        Largest size of the angle of nod (about x), turn (about y) and tilt (about z), deg; an axis with 0
        does not move at all. One number stands for all three.
    speed : float
        Fastest change of posture about one axis, deg/s.
    profile : str
        Speed profile, a name in `evalkit.synthetic.motion.PROFILES`.
    sway : float
        Largest distance of the pivot from its mean place, mm; 0 is a fixed pivot.
    sway_hz : float
        Upper end of the sway's band, Hz.
    neck_gap_mm : float
        Neck of two joints: how far the centre of the nod lies above the pivot, which is then the centre of turn
        and tilt, mm; negative below it, 0 a neck of one joint.
    actions : tuple of str
        Expression patterns performed, names in `evalkit.synthetic.expression.ACTION_NAMES`.
    expression : float
        Strength of the expressions, 1 ordinary, 0 none.
    liveliness : float
        How often expressions come, 1 as in ordinary talk.
    asymmetry : float
        How one-sided smiles, brow raises and frowns are: 1 the performer's left alone, -1 the right alone.
    skin : float
        Slide of the forehead skin at the brows when these work at full strength, mm. The "rigid" markers
        slide with it.
    noise : float
        Standard deviation of the Gaussian noise per axis, mm.
    noise_time_s : float
        Correlation time of the noise, s; 0 is white.
    noise_shared : float
        Part of the noise's variance that neighbouring markers share.
    quantum_mm : float
        Distance of neighbouring values of the grid to which coordinates are rounded, as in a C3D file of
        integers, mm; 0 does not round.
    gaps : float
        Expected share of missing marker samples, 0 to 0.9.
    gap_bursts : float
        Share of the gaps that are bursts; the others are single frames.
    gap_length : int
        Mean length of a burst, frames.
    outliers : float
        Expected share of displaced marker samples, 0 to 0.5 (of which gaps then take their part).
    outlier_mm : float
        Mean displacement of an outlier, mm; it lies between half and one and a half of this.
    outlier_bursts : float
        Share of the outliers that are bursts with one displacement (ghosts); the others are single spikes.
    outlier_length : int
        Mean length of such a burst, frames.
    swaps : float
        Expected share of the time that two neighbours have their labels exchanged, 0 to 0.5; markers without one
        within 40 mm keep theirs.
    swap_length : int
        Mean length of an exchange of labels, frames.

    Raises
    ------
    EvalkitError
        If a value is of the wrong type or out of range.
    """

    layout: str = "paper-23"
    performer: int = 0
    frames: int = 600
    rate: float = 60.0
    range_deg: tuple[float, float, float] = (20.0, 20.0, 20.0)
    speed: float = 100.0
    profile: str = "talk"
    sway: float = 0.0
    sway_hz: float = 0.25
    neck_gap_mm: float = 0.0
    actions: tuple[str, ...] = ACTION_NAMES
    expression: float = 1.0
    liveliness: float = 1.0
    asymmetry: float = 0.0
    skin: float = 0.0
    noise: float = 0.3
    noise_time_s: float = 0.0
    noise_shared: float = 0.0
    quantum_mm: float = 0.0
    gaps: float = 0.0
    gap_bursts: float = 0.5
    gap_length: int = 15
    outliers: float = 0.0
    outlier_mm: float = 30.0
    outlier_bursts: float = 0.5
    outlier_length: int = 15
    swaps: float = 0.0
    swap_length: int = 30

    def __post_init__(self) -> None:
        for name, field in FIELDS.items():
            if field.limits is not None:
                object.__setattr__(self, name, _number(name, getattr(self, name), field.limits))
        object.__setattr__(self, "range_deg", _angles(self.range_deg))
        for name, known in NAMED.items():
            if not isinstance(getattr(self, name), str) or getattr(self, name) not in known:
                raise EvalkitError(f"{name} {getattr(self, name)!r} is not one of {', '.join(known)}")
        if not isinstance(self.actions, Iterable):
            raise EvalkitError(f"actions = {self.actions!r} are not names out of {', '.join(ACTION_NAMES)}")
        actions = (self.actions,) if isinstance(self.actions, str) else tuple(self.actions)
        for action in actions:
            if action not in ACTION_NAMES:
                raise EvalkitError(unknown("action", action, ACTION_NAMES))
        object.__setattr__(self, "actions", actions)

    def replaced(self, overrides: Mapping[str, Any]) -> Parameters:
        """The same parameters with some of them changed by name.

        Raises
        ------
        EvalkitError
            If a name is not a parameter (the nearest one is suggested) or a value does not fit.
        """
        names = [field.name for field in dataclasses.fields(self)]
        for name in overrides:
            if name not in names:
                raise EvalkitError(unknown("parameter", name, names))
        return dataclasses.replace(self, **overrides)

    def settings(self) -> str:
        """What differs from the defaults, as ``--set`` reads it."""
        default = Parameters()
        return " ".join(
            f"{name}={setting(getattr(self, name))}" for name in FIELDS if getattr(self, name) != getattr(default, name)
        )

    def as_dict(self) -> dict[str, Any]:
        """The parameters as JSON types."""
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in dataclasses.asdict(self).items()
        }


def setting(value: object) -> str:
    """A parameter's value as `parse_overrides` reads it."""
    if isinstance(value, tuple):
        return ",".join(map(setting, value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


def unknown(kind: str, name: object, known: Sequence[str]) -> str:
    """One line saying that a name is not known and which one is nearest."""
    near = difflib.get_close_matches(str(name).lower().replace("-", "_"), known, n=1, cutoff=0.5)
    near = near or difflib.get_close_matches(str(name).lower(), known, n=1, cutoff=0.4)
    hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(known)}"
    return f"{kind} {str(name)!r} is not known; {hint}"


def _number(name: str, value: object, limits: tuple[float, float]) -> float | int:
    whole = name in WHOLE
    kind = "a whole number" if whole else "a number"
    low, high = limits
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
        raise EvalkitError(f"{name} = {value!r} is not {kind} from {low:g} to {high:g}")
    number = int(value) if whole and isinstance(value, Integral) else float(value)
    if not (math.isfinite(number) and low <= number <= high):
        raise EvalkitError(f"{name} = {value!r} is not {kind} from {low:g} to {high:g}")
    return number


def _angles(value: object) -> tuple[float, float, float]:
    if isinstance(value, Real):
        value = (value, value, value)
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise EvalkitError(f"range_deg = {value!r} is not one angle or three (nod, turn, tilt), deg")
    angles = [float(_number("range_deg", angle, (0.0, LARGEST_ANGLE_DEG))) for angle in value]
    if len(angles) != 3:
        raise EvalkitError(f"range_deg has {len(angles)} angles; give one or three (nod, turn, tilt), deg")
    return angles[0], angles[1], angles[2]


def parse_overrides(settings: Iterable[str]) -> dict[str, Any]:
    """Overrides from ``name=value`` texts, as on a command line.

    Lists are separated by commas: ``range_deg=20,10,5``, ``actions=speech,blink``.

    Raises
    ------
    EvalkitError
        If a text has no ``=``, the name is not a parameter, or the value does not read as its type.
    """
    defaults = {field.name: field.default for field in dataclasses.fields(Parameters)}
    overrides: dict[str, Any] = {}
    for setting in settings:
        name, equals, text = (part.strip() for part in setting.partition("="))
        if not equals:
            raise EvalkitError(f"setting {setting!r} is not of the form name=value")
        if name not in defaults:
            raise EvalkitError(unknown("parameter", name, list(defaults)))
        parts = [part.strip() for part in text.split(",") if part.strip()]
        try:
            if name in NAMED:
                overrides[name] = text
            elif name == "actions":
                overrides[name] = tuple(parts)
            elif name == "range_deg":
                overrides[name] = float(text) if len(parts) == 1 else tuple(float(part) for part in parts)
            else:
                overrides[name] = int(text) if name in WHOLE else float(text)
        except ValueError:
            kind = "a whole number" if name in WHOLE else "a number"
            raise EvalkitError(f"{name} = {text!r} does not read as {kind}") from None
    return overrides
