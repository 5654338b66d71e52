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
    from pathlib import Path
    from types import ModuleType

    figures: dict[str, ModuleType]

MODULES = (
    "huang_1",
    "huang_2",
    "huang_3",
    "huang_4",
    "huang_5",
    "pose_noise",
    "pivot_noise",
    "pivot_range_of_motion",
    "pivot_sway",
    "reference",
    "optimiser_race",
    "angle_term",
    "bold_driver",
    "covariance_calibration",
    "real_takes",
    "skin",
    "gaps",
    "outliers",
    "two_joint_neck",
    "marker_layout",
    "capture_rate",
    "rbf_kernels",
    "kernels_lips",
    "seam_treatments",
    "seam",
    "static_points",
    "marker_count",
    "kernel_scale",
    "units",
    "photo_fit",
    "head_pose",
    "template_update",
    "control_parameters",
    "tracker_speed",
    "frame_rate",
    "scaling",
    "kato_3",
    "kato_4",
    "kato_5",
    "kato_7",
    "kato_8",
    "kato_table_1",
    "kato_table_2",
    "two_artists",
    "training_size",
    "region_count",
    "blend_kinds",
    "coefficient_kinds",
    "unlike_expressions",
    "left_or_right_mapping",
    "example_choice",
    "retarget",
    "knn",
    "factorisation",
    "control_filter",
    "control_synthesis",
    "end_to_end",
)
"""Files of this folder that are figures, in the order of the paper that they would make; ``figures`` is the table of
them, name to module. They are imported when it is first looked at."""


def __getattr__(name: str) -> Any:
    if name == "figures":
        found = [import_module(f"{__name__}.{module}") for module in MODULES]
        globals()["figures"] = {module.NAME: module for module in found}
        return globals()["figures"]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def figure_named(name: str) -> ModuleType:
    """A figure by its name.

    Raises
    ------
    EvalkitError
        If there is none, with the nearest names.
    """
    import difflib

    from evalkit.errors import EvalkitError
    from evalkit.figures import figures as known

    if name not in known:
        near = difflib.get_close_matches(name, known, n=2, cutoff=0.4)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known)}"
        raise EvalkitError(f"figure '{name}' is not known; {hint}")
    return known[name]


def show(name: str, budget: str = "small", results: Path | None = None) -> Any:
    """A figure measured here and drawn, as a notebook shows it.

    Parameters
    ----------
    name : str
        Of the table ``figures``.
    budget : {"small", "full"}
    results : Path, optional
        Where tables of studies are kept, to go on from; nothing is written if not given.

    Returns
    -------
    Figure or ndarray
        Of matplotlib, or the picture (H, W, 3) of a scene.

    Raises
    ------
    EvalkitError
        If there is no such figure or budget, or it cannot be measured.
    """
    from evalkit.figures.files import draw
    from evalkit.figures.table import measured

    figure = figure_named(name)
    return draw(figure, measured(figure, budget, results))
