"""Studies: what the methods are worth on takes whose truth is known, one file each."""

from evalkit.studies.pivot_noise import study as pivot_noise
from evalkit.study.description import Study

studies: dict[str, Study] = {study.name: study for study in (pivot_noise,)}
"""Name to study; the command line and the tests take their lists from here."""
