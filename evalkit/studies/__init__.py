"""Studies: what the methods are worth on takes whose truth is known, one file each."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evalkit.study.description import Study

    studies: dict[str, Study]

MODULES = (
    "pivot_noise",
    "pivot_range_of_motion",
    "pivot_sway",
    "covariance_calibration",
    "objective_terms",
    "optimisers",
    "bold_driver",
    "pose_noise",
    "gaps",
    "outliers",
    "skin",
    "two_joint_neck",
    "marker_layout",
    "capture_rate",
    "real_takes",
    "scaling",
    "rbf_kernels",
    "regions",
    "static_points",
    "marker_count",
    "kernel_scale",
    "units",
    "photo_fit",
    "head_pose",
    "template_update",
    "parameters",
    "tracker_speed",
    "transfer_methods",
    "two_artists",
    "training_size",
    "region_count",
    "blend_kinds",
    "coefficient_kinds",
    "unlike_expressions",
    "transfer_animation",
    "left_or_right_mapping",
    "example_choice",
    "factorisation",
    "retarget",
    "knn",
    "control_filter",
    "control_synthesis",
    "end_to_end",
)
"""Files of this folder that hold a ``study``, by theme; ``studies`` is the table of them, name to study, from which
the command line and the tests take their lists. They are imported when it is first looked at."""


def __getattr__(name: str) -> Any:
    if name == "studies":
        found = [import_module(f"{__name__}.{module}").study for module in MODULES]
        globals()["studies"] = {study.name: study for study in found}
        return globals()["studies"]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
