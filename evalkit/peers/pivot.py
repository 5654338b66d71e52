"""Pivot estimators of other packages, from the poses of every frame."""

from __future__ import annotations

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.peers.calling import installed, words_of
from evalkit.pivot.model import Pivot, PivotEstimator
from evalkit.pose.model import Pose


def pivot_calibration_aos(points: Array, pose: Pose, **_: object) -> Pivot:
    """Algebraic one-step pivot calibration of scikit-surgerycalibration: least squares of ``R_i b + c_i = O``.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Not used.
    pose : Pose

    Raises
    ------
    EvalkitError
        With the package's words, such as a rank below six.

    References
    ----------
    Yaniv, SPIE Medical Imaging 9415 (2015), doi:10.1117/12.2081348, section 2.1.2.
    """
    return _pivot_calibration(pose, "aos")


def pivot_calibration_sphere(points: Array, pose: Pose, **_: object) -> Pivot:
    """Sphere fit of scikit-surgerycalibration, to the path of the markers' centroid.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Not used.
    pose : Pose

    Raises
    ------
    EvalkitError
        With the package's words.

    References
    ----------
    Yaniv, SPIE Medical Imaging 9415 (2015), doi:10.1117/12.2081348, section 2.1.1.
    """
    return _pivot_calibration(pose, "sphere_fitting")


def _pivot_calibration(pose: Pose, method: str) -> Pivot:
    rotations, centroids = _tracked(pose)
    matrices = np.tile(np.eye(4), (len(rotations), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotations, centroids
    with words_of("scikit-surgerycalibration pivot_calibration"):
        from sksurgerycalibration.algorithms.pivot import pivot_calibration

        _, position, residual = pivot_calibration(matrices, {"method": method})
    return _answer(np.ravel(position), f"scikit-surgerycalibration gives a residual of {float(residual):.3f} mm")


def score(points: Array, pose: Pose, **_: object) -> Pivot:
    """SCoRE of biobuddy with its removal of outlying frames; the parent segment is the world.

    Its own pose reconstruction, which reads marker files in metres against a static trial, is not used: the poses are
    those that the other pivot estimators get.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3), mm
        Not used.
    pose : Pose

    Raises
    ------
    EvalkitError
        With the package's words.

    References
    ----------
    Ehrig et al., J. Biomechanics 39 (2006), doi:10.1016/j.jbiomech.2005.10.002.
    """
    rotations, centroids = _tracked(pose)
    world = np.tile(np.eye(3)[:, :, None], (1, 1, len(rotations)))
    with words_of("biobuddy Score"):
        from biobuddy import RotoTransMatrixTimeSeries, Score

        series = RotoTransMatrixTimeSeries.from_rotation_matrix_and_translation
        head = series(rotations.transpose(1, 2, 0), centroids.T)
        _, position, *_rest = Score.perform_algorithm(series(world, np.zeros((3, len(rotations)))), head)
    return _answer(position, "biobuddy gives no residual")


def _tracked(pose: Pose) -> tuple[Array, Array]:
    """Rotations and the markers' centroid in the frames with a pose: what a tracker would report of the body.

    The origin of evalkit's poses is the laboratory's, and no point of the head: a sphere through it means nothing.
    """
    if not pose.ok.any():
        raise EvalkitError("no frame has a head pose; a pivot needs the head to turn")
    rotations = pose.rotations[pose.known]
    return rotations, pose.translations[pose.known] + rotations @ pose.template.mean(axis=0)


def _answer(position: Array, message: str) -> Pivot:
    """A peer's position as it gave it: no covariance, and no verdict on what the motion shows."""
    unknown = np.full((3, 3), np.nan)
    status = "ok" if np.isfinite(position).all() else "not-converged"
    return Pivot(np.asarray(position, dtype=np.float64), unknown, status, f"{message}; no covariance, no verdict")


def pivot_peers() -> dict[str, PivotEstimator]:
    """The entries of the packages that are installed."""
    surgery = installed("sksurgerycalibration", "scikit-surgerycalibration")
    entries = {
        "peer-scikit-surgery-aos": PivotEstimator(
            pivot_calibration_aos, "scikit-surgerycalibration's algebraic one step", "Yaniv 2015",
            origin=surgery, peer=True,
        ),
        "peer-scikit-surgery-sphere": PivotEstimator(
            pivot_calibration_sphere, "scikit-surgerycalibration's sphere fit", "Yaniv 2015",
            origin=surgery, peer=True,
        ),
        "peer-biobuddy-score": PivotEstimator(
            score, "biobuddy's SCoRE with outlying frames removed", "Ehrig et al. 2006",
            origin=installed("biobuddy", "biobuddy"), peer=True,
        ),
    }  # fmt: skip
    return {name: entry for name, entry in entries.items() if entry.origin}
