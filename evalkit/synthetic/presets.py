"""Presets: parameters with a name, each for one question."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from evalkit.errors import EvalkitError
from evalkit.plugins import Table
from evalkit.synthetic.parameters import Parameters


@dataclass(frozen=True)
class Preset:
    """Parameters with a name's worth of meaning.

    Parameters
    ----------
    text : str
        One line on what it is for.
    parameters : Parameters
        What it is made of.
    origin : str
        Name and version of the package it comes from, empty for evalkit's own.
    """

    text: str
    parameters: Parameters
    origin: str = ""


OWN: dict[str, Preset] = {
    "talking": Preset(
        "ordinary talk: fixed neck pivot, ±20°, speech and expressions, 0.3 mm noise",
        Parameters(),
    ),
    "clean": Preset(
        "the same performance without noise: every method must be exact",
        Parameters(noise=0.0),
    ),
    "dense": Preset(
        "63 markers, seven of them rigid: what more markers are worth",
        Parameters(layout="dense-63"),
    ),
    "reduced": Preset(
        "12 markers, four of them rigid: what few markers cost",
        Parameters(layout="reduced-12"),
    ),
    "single-axis": Preset(
        "nods only: the pivot cannot be observed along the axis of the nod",
        Parameters(range_deg=(20.0, 0.0, 0.0)),
    ),
    "small-motion": Preset(
        "a nearly still head, ±2°: the pivot is hardly observable",
        Parameters(range_deg=(2.0, 2.0, 2.0)),
    ),
    "held": Preset(
        "postures held for seconds: few that differ, however many frames",
        Parameters(range_deg=(15.0, 20.0, 10.0), speed=60.0, profile="held"),
    ),
    "shaking": Preset(
        "fast nodding and shaking at 120 Hz: what smoothing in time destroys",
        Parameters(rate=120.0, range_deg=(12.0, 15.0, 4.0), speed=300.0, profile="shaking"),
    ),
    "reading": Preset(
        "line after line is read: the head mostly turns, and little else",
        Parameters(range_deg=(4.0, 15.0, 2.0), profile="reading"),
    ),
    "sway": Preset(
        "the body sways: the pivot itself drifts slowly by up to 20 mm",
        Parameters(sway=20.0),
    ),
    "two-joints": Preset(
        "a neck of two joints: the head nods 50 mm above where it turns and tilts",
        Parameters(neck_gap_mm=50.0),
    ),
    "skin": Preset(
        "the forehead skin, with its markers, slides by millimetres when the brows work",
        Parameters(skin=4.0, liveliness=1.5),
    ),
    "one-sided": Preset(
        "lively one-sided smiles and brows over sliding skin: expression that looks like a turn",
        Parameters(asymmetry=0.8, skin=4.0, liveliness=2.0, expression=1.3),
    ),
    "coloured-noise": Preset(
        "noise correlated over 0.2 s and between neighbours: averaging helps less than it seems",
        Parameters(noise_time_s=0.2, noise_shared=0.5),
    ),
    "quantised": Preset(
        "coordinates on the 0.1 mm grid of a C3D file of integers, little other noise",
        Parameters(noise=0.02, quantum_mm=0.1),
    ),
    "gaps": Preset(
        "8 % of all samples missing, singly and in bursts, rigid markers included",
        Parameters(gaps=0.08),
    ),
    "outliers": Preset(
        "3 % of all samples tens of millimetres off, spikes and ghosts, seven rigid markers",
        Parameters(layout="dense-63", outliers=0.03),
    ),
    "label-swaps": Preset(
        "neighbours' labels exchanged 5 % of the time, a quarter of a second each, seven rigid markers",
        Parameters(layout="dense-63", swaps=0.05, swap_length=15),
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
"""The presets of this package."""

PRESETS = Table(OWN, "evalkit.presets", Preset)
"""Preset -> what it is for and its parameters, plugins included."""


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
