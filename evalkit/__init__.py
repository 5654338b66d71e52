"""Facial motion capture from raw markers to a believable animated face, every step measured against truth.

The public names below are loaded when they are first used: importing evalkit loads neither VTK, NLopt,
matplotlib nor SciPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from evalkit.errors import CaptureError, EvalkitError, FrameStatus

if TYPE_CHECKING:
    from evalkit.capture import Capture, read_capture, write_capture
    from evalkit.compensation import Compensation, compensate
    from evalkit.deform import deformation_map
    from evalkit.deform.kernels import kernels
    from evalkit.head import Head, load_head
    from evalkit.pivot import pivot_estimators
    from evalkit.pose import pose_estimators
    from evalkit.published import compensate_as_published
    from evalkit.synthetic import synthesize
    from evalkit.transfer.character import transfer_character

__version__ = "0.1.0"

_HOMES = {
    "Capture": "evalkit.capture",
    "read_capture": "evalkit.capture",
    "write_capture": "evalkit.capture",
    "Compensation": "evalkit.compensation",
    "compensate": "evalkit.compensation",
    "compensate_as_published": "evalkit.published",
    "Head": "evalkit.head",
    "load_head": "evalkit.head",
    "pose_estimators": "evalkit.pose",
    "pivot_estimators": "evalkit.pivot",
    "synthesize": "evalkit.synthetic",
    "deformation_map": "evalkit.deform",
    "kernels": "evalkit.deform.kernels",
    "transfer_character": "evalkit.transfer.character",
}

__all__ = [
    "Capture",
    "CaptureError",
    "Compensation",
    "EvalkitError",
    "FrameStatus",
    "Head",
    "compensate",
    "compensate_as_published",
    "deformation_map",
    "kernels",
    "load_head",
    "pivot_estimators",
    "pose_estimators",
    "read_capture",
    "synthesize",
    "transfer_character",
    "write_capture",
]


if not TYPE_CHECKING:  # a type checker that saw it would take every misspelt name for a public one

    def __getattr__(name: str) -> Any:
        if name in _HOMES:
            value = getattr(import_module(_HOMES[name]), name)
            globals()[name] = value
            return value
        raise AttributeError(f"module 'evalkit' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
