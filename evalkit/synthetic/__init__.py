"""Synthetic captures with their truth: performers, motions, expressions, faults, presets.

To add a preset, add a line to `evalkit.synthetic.parameters.PRESETS`; a pattern of expression, to `PATTERNS`
in `expression`; a marker layout, to `LAYOUTS` in `performer`.
"""

from evalkit.synthetic.parameters import PRESETS, Parameters, Preset, parse_overrides
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
