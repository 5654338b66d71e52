"""Synthetic captures with their truth: performers, motions, expressions, faults, presets.

To add a preset, add an entry to `OWN` in `presets`; a pattern of expression, to `PATTERNS` in `expression`; a
marker layout, to `LAYOUTS` in `layouts`; a way of moving, to `PROFILES` in `motion`; a parameter, a field to
`Parameters` and its line to `FIELDS` in `parameters`. Other packages add presets through `evalkit.plugins`.
"""

from evalkit.synthetic.parameters import Parameters, parse_overrides
from evalkit.synthetic.presets import PRESETS, Preset
from evalkit.synthetic.take import SyntheticFiles, synthesize, write_synthetic
from evalkit.synthetic.truth import Truth

__all__ = [
    "PRESETS",
    "Parameters",
    "Preset",
    "SyntheticFiles",
    "Truth",
    "parse_overrides",
    "synthesize",
    "write_synthetic",
]
