"""The table of head trackers, and what each needs on this machine."""

from __future__ import annotations

from importlib.util import find_spec

from evalkit.errors import EvalkitError
from evalkit.head.detector import WEIGHTS_NAME, WEIGHTS_VARIABLE, landmarker_weights
from evalkit.vision.tracker import HeadTracker, TrackerMethod


def _cylinder() -> HeadTracker:
    from evalkit.vision.cylinder import CylinderTracker

    return CylinderTracker()


def _face_surface() -> HeadTracker:
    from evalkit.vision.cylinder import CylinderTracker, Settings

    return CylinderTracker(Settings(surface="face"))


def _learnt_relief() -> HeadTracker:
    from evalkit.vision.cylinder import CylinderTracker, Settings

    return CylinderTracker(Settings(surface="learnt"))


def _pyrlk() -> HeadTracker:
    from evalkit.vision.pyrlk import PyrLkTracker

    return PyrLkTracker()


def _mediapipe() -> HeadTracker:
    from evalkit.vision.landmarker import LandmarkerTracker

    return LandmarkerTracker()


trackers: dict[str, TrackerMethod] = {
    "cylinder": TrackerMethod(
        _cylinder, "a textured cylinder registered to every frame, with references against drift", "Xiao et al. 2003"
    ),
    "face-surface": TrackerMethod(
        _face_surface, "the same with the relief of the mean face in place of the cylinder", "Xiao et al. 2003"
    ),
    "learnt-relief": TrackerMethod(
        _learnt_relief, "the same with a relief that is corrected by what the video shows", "Xiao et al. 2003"
    ),
    "pyrlk": TrackerMethod(_pyrlk, "corners by optical flow, pose of a rigid face from them", "Bouguet 2001"),
    "mediapipe": TrackerMethod(
        _mediapipe, "MediaPipe's face landmarker, asked anew about every frame", "Grishchenko et al. 2020"
    ),
}
"""Name -> tracker. Packages and weights are looked for when one is built, so that the table can be read without."""

DEFAULT = "learnt-relief"
"""The tracker that is taken if none is asked for: the best of those that need no trained network."""


def missing(method: str) -> str:
    """What a tracker lacks on this machine, in one line; empty if nothing."""
    if find_spec("cv2") is None:
        return "OpenCV is missing: pip install 'evalkit[vision]'"
    return missing_detector() if method == "mediapipe" else ""


def missing_detector() -> str:
    """What the face detector lacks on this machine, in one line; empty if nothing."""
    if find_spec("mediapipe") is None:
        return "MediaPipe is missing: pip install 'evalkit[vision]'"
    try:
        landmarker_weights()
    except EvalkitError:
        return f"its weights are missing: name {WEIGHTS_NAME} in {WEIGHTS_VARIABLE}"
    return ""
