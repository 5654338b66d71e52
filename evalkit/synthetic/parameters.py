"""What a synthetic take is made of, and the presets."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from evalkit.errors import EvalkitError
from evalkit.synthetic.expression import ACTION_NAMES
from evalkit.synthetic.performer import LAYOUTS

LIMITS: dict[str, tuple[float, float]] = {
    "frames": (1, 2_000_000),
    "rate": (1, 10_000),
    "performer": (0, 2**31),
    "speed": (1, 1000),
    "range_deg": (0, 90),
    "sway": (0, 1000),
    "sway_hz": (0.01, 2),
    "expression": (0, 3),
    "liveliness": (0.05, 20),
    "skin": (0, 30),
    "noise": (0, 100),
    "gaps": (0, 0.9),
    "gap_bursts": (0, 1),
    "gap_length": (1, 10_000),
}
"""Smallest and largest value of every number."""

WHOLE = ("frames", "performer", "gap_length")
"""Fields that are whole numbers."""


@dataclass(frozen=True)
class Parameters:
    """Everything that a synthetic take depends on, besides its seed.

    Parameters
    ----------
    layout : str
        Marker layout, a name in `evalkit.synthetic.performer.LAYOUTS`.
    performer : int
        0 is the average face; other numbers are other people.
    frames : int
        Number of frames F.
    rate : float
        Frames per second, Hz.
    range_deg : (float, float, float)
        Largest |angle| that nod (about x), turn (about y) and tilt (about z) reach, deg; an axis with 0
        does not move at all. One number stands for all three.
    speed : float
        Fastest change of posture about one axis, deg/s.
    sway : float
        Largest distance of the pivot from its mean place, mm; 0 is a fixed pivot.
    sway_hz : float
        Upper end of the sway's band, Hz.
    actions : tuple of str
        Expression patterns performed, names in `evalkit.synthetic.expression.ACTION_NAMES`.
    expression : float
        Strength of the expressions, 1 ordinary, 0 none.
    liveliness : float
        How often expressions come, 1 as in ordinary talk.
    skin : float
        Slide of the forehead skin at the brows when these work at full strength, mm. The "rigid" markers
        slide with it.
    noise : float
        Standard deviation of white Gaussian noise per axis, mm.
    gaps : float
        Expected share of missing marker samples, 0 to 0.9.
    gap_bursts : float
        Share of the gaps that are bursts; the others are single frames.
    gap_length : int
        Mean length of a burst, frames.

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
    sway: float = 0.0
    sway_hz: float = 0.25
    actions: tuple[str, ...] = ACTION_NAMES
    expression: float = 1.0
    liveliness: float = 1.0
    skin: float = 0.0
    noise: float = 0.3
    gaps: float = 0.0
    gap_bursts: float = 0.5
    gap_length: int = 15

    def __post_init__(self) -> None:
        for name in LIMITS:
            if name != "range_deg":
                object.__setattr__(self, name, _number(name, getattr(self, name)))
        object.__setattr__(self, "range_deg", _angles(self.range_deg))
        if not isinstance(self.layout, str) or self.layout not in LAYOUTS:
            raise EvalkitError(f"layout {self.layout!r} is not one of {', '.join(LAYOUTS)}")
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

    def as_dict(self) -> dict[str, Any]:
        """The parameters as JSON types."""
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in dataclasses.asdict(self).items()
        }


def unknown(kind: str, name: object, known: Sequence[str]) -> str:
    """One line saying that a name is not known and which one is nearest."""
    near = difflib.get_close_matches(str(name).lower().replace("-", "_"), known, n=1, cutoff=0.5)
    near = near or difflib.get_close_matches(str(name).lower(), known, n=1, cutoff=0.4)
    hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(known)}"
    return f"{kind} {str(name)!r} is not known; {hint}"


def _number(name: str, value: object) -> float | int:
    whole = name in WHOLE
    kind = "a whole number" if whole else "a number"
    low, high = LIMITS[name]
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
    angles = [float(_number("range_deg", angle)) for angle in value]
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
            if name == "layout":
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


@dataclass(frozen=True)
class Preset:
    """Parameters with a name's worth of meaning.

    Parameters
    ----------
    text : str
        One line on what it is for.
    parameters : Parameters
        What it is made of.
    """

    text: str
    parameters: Parameters


PRESETS: dict[str, Preset] = {
    "talking": Preset(
        "ordinary talk: fixed neck pivot, ±20°, speech and expressions, 0.3 mm noise",
        Parameters(),
    ),
    "clean": Preset(
        "the same performance without noise: every method must be exact",
        Parameters(noise=0.0),
    ),
    "sway": Preset(
        "the body sways: the pivot itself drifts slowly by up to 20 mm",
        Parameters(sway=20.0),
    ),
    "gaps": Preset(
        "8 % of all samples missing, singly and in bursts, rigid markers included",
        Parameters(gaps=0.08),
    ),
    "single-axis": Preset(
        "nods only: the pivot cannot be observed along the axis of the nod",
        Parameters(range_deg=(20.0, 0.0, 0.0)),
    ),
    "small-motion": Preset(
        "a nearly still head, ±2°: the pivot is hardly observable",
        Parameters(range_deg=(2.0, 2.0, 2.0)),
    ),
    "skin": Preset(
        "the forehead skin, with its markers, slides by millimetres when the brows work",
        Parameters(skin=4.0, liveliness=1.5),
    ),
    "worst-day": Preset(
        "all at once: small range, sway, sliding skin, strong noise, many gaps",
        Parameters(
            range_deg=(8.0, 10.0, 5.0),
            sway=20.0,
            skin=4.0,
            liveliness=1.5,
            noise=0.6,
            gaps=0.15,
            gap_length=30,
        ),
    ),
}
"""Preset -> what it is for and its parameters."""


def preset_parameters(preset: str, overrides: Mapping[str, Any]) -> Parameters:
    """Parameters of a preset with overrides.

    Raises
    ------
    EvalkitError
        If the preset or an override is not known or a value does not fit.
    """
    if not isinstance(preset, str) or preset not in PRESETS:
        near = difflib.get_close_matches(str(preset).lower().replace("_", "-"), PRESETS, n=1, cutoff=0.4)
        hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(PRESETS)}"
        raise EvalkitError(f"preset {str(preset)!r} is not known; {hint}")
    return PRESETS[preset].parameters.replaced(overrides)
