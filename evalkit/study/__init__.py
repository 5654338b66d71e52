"""Studies that anyone can rerun.

``description`` says what a study is, ``runner.run`` measures its cells here or on a cluster and goes on where it
stopped, ``statistics`` and ``table`` make numbers with intervals of them, ``provenance`` says where they come from.
The studies themselves are in :mod:`evalkit.studies`, one file each.
"""
