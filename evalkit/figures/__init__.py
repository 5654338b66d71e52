"""Figures: from a table to a picture, one file each.

A module here is a figure. Its docstring is the caption; it has

- ``NAME``: the name of its files;
- ``STUDY``: the study whose rows it shows, with ``SMALL``, that study's small budget where the study's own would leave
  an axis with one value, and ``FULL`` likewise; or ``measure(budget)``, which gives rows of its own;
- ``draw(table)``: a matplotlib figure, or a picture (H, W, 3) of a scene, from a :class:`~evalkit.figures.table.Table`.

``draw`` sees nothing but the rows, so that a figure is drawn again from its CSV without measuring anything.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from types import ModuleType

    figures: dict[str, ModuleType]

MODULES = ("pivot_noise",)
"""Files of this folder that are figures, in the order of the paper that they would make; ``figures`` is the table of
them, name to module. They are imported when it is first looked at."""


def __getattr__(name: str) -> Any:
    if name == "figures":
        found = [import_module(f"{__name__}.{module}") for module in MODULES]
        globals()["figures"] = {module.NAME: module for module in found}
        return globals()["figures"]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
