"""Pose estimators of other packages."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evalkit.errors import EvalkitError, FrameStatus
from evalkit.geometry import Array
from evalkit.peers.calling import installed, words_of
from evalkit.pose.model import Pose, PoseEstimator, check


def align_vectors(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """Rotation by ``scipy.spatial.transform.Rotation.align_vectors`` of the centred markers, frame by frame.

    The package has no notion of a missing marker: a frame that lacks one is handed over as it is.

    Parameters
    ----------
    template : array_like, shape (M, 3), mm
    points : array_like, shape (F, M, 3), mm
    weights : array_like, shape (M,) or (F, M), optional

    Raises
    ------
    EvalkitError
        With the package's words, as soon as one frame fails: the whole take has no answer then.
    """
    from scipy.spatial.transform import Rotation

    shape, x = check(template, points)
    given = np.ones(len(shape)) if weights is None else np.asarray(weights, dtype=np.float64)
    rotations, translations = np.empty((len(x), 3, 3)), np.empty((len(x), 3))
    for frame, (seen, weight) in enumerate(zip(x, np.broadcast_to(given, x.shape[:2]), strict=True)):
        with words_of(f"scipy align_vectors, frame {frame},"):
            there, here = np.average(seen, axis=0, weights=weight), np.average(shape, axis=0, weights=weight)
            rotation, _ = Rotation.align_vectors(seen - there, shape - here, weights=weight)
            rotations[frame] = rotation.as_matrix()
            translations[frame] = there - rotations[frame] @ here
    return _pose(rotations, translations, shape, given)


def register_points(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """Pose by ``kineticstoolkit.geometry.register_points``; markers that are NaN are left out by the package itself.

    Parameters
    ----------
    template : array_like, shape (M, 3), mm
    points : array_like, shape (F, M, 3), mm, NaN where missing
    weights : array_like, optional
        The package takes none: they must be equal.

    Raises
    ------
    EvalkitError
        If weights differ, or with the package's words.
    """
    shape, x = check(template, points)
    given = np.ones(len(shape)) if weights is None else np.asarray(weights, dtype=np.float64)
    if not (given == given.flat[0]).all():
        raise EvalkitError("kineticstoolkit register_points takes no weights; name the rigid markers instead")
    # Its arrays are frames x homogeneous coordinates x markers.
    world = np.concatenate([x, np.ones((*x.shape[:2], 1))], axis=2).transpose(0, 2, 1)
    local = np.concatenate([shape, np.ones((len(shape), 1))], axis=1).T
    with words_of("kineticstoolkit register_points"):
        import kineticstoolkit.geometry as geometry

        transforms = geometry.register_points(world, np.broadcast_to(local, world.shape))
    return _pose(transforms[:, :3, :3], transforms[:, :3, 3], shape, given)


def _pose(rotations: Array, translations: Array, template: Array, weights: Array) -> Pose:
    """What a peer answered; a frame without a number is one that it had too few markers for."""
    answered = np.isfinite(rotations).all(axis=(1, 2)) & np.isfinite(translations).all(axis=1)
    status = np.where(answered, FrameStatus.OK, FrameStatus.TOO_FEW_MARKERS).astype(np.int8)
    return Pose(rotations, translations, status, template, weights)


def pose_peers() -> dict[str, PoseEstimator]:
    """The entries of the packages that are installed."""
    entries = {
        "peer-scipy": PoseEstimator(
            align_vectors, "scipy's align_vectors, no missing markers", "Kabsch 1976",
            origin=installed("scipy", "scipy"), peer=True,
        ),
        "peer-kineticstoolkit": PoseEstimator(
            register_points, "kineticstoolkit's register_points, no weights", "Chénier 2021",
            origin=installed("kineticstoolkit", "kineticstoolkit"), peer=True,
        ),
    }  # fmt: skip
    return {name: entry for name, entry in entries.items() if entry.origin}
