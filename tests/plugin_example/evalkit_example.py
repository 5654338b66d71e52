"""One entry for each table of evalkit that other packages can add to."""

import numpy as np

from evalkit.deform.kernels import Kernel
from evalkit.geometry import nearest_rotation
from evalkit.pivot.model import PivotEstimator, judge
from evalkit.pose.model import PoseEstimator, moments
from evalkit.synthetic import Parameters, Preset


def polar(template, points, weights=None):
    """Pose of every frame: the rotation nearest to the cross-products of the centred markers."""
    sums = moments(template, points, weights)  # deals with missing markers, weights and statuses
    return sums.pose(nearest_rotation(sums.cross))


def one_step(points, pose, **_):
    """Pivot by least squares of ``O - R_i b = c_i``, c_i the markers' centroid; mm, world axes."""
    r = pose.rotations[pose.known]
    middle = pose.template.mean(axis=0)
    c = pose.translations[pose.known] + r @ middle
    origin = c.mean(axis=0)  # metres from the laboratory's origin would cost digits
    design = np.concatenate([np.broadcast_to(np.eye(3), r.shape), -r], axis=2).reshape(-1, 6)
    right = (c - origin).ravel()
    inverse = np.linalg.pinv(design, rcond=1e-10)
    solution = inverse @ right
    variance = ((right - design @ solution) ** 2).sum() / max(len(right) - 6, 1)
    covariance = variance * (inverse[:3] @ inverse[:3].T)
    return judge(origin + solution[:3], covariance, points, pose)  # attaches what the motion can and cannot show


def wendland_c4(r):
    """``(1 - r)^6 (35 r^2 + 18 r + 3) / 3`` up to 1, zero beyond."""
    return np.maximum(1 - r, 0.0) ** 6 * (35 * r**2 + 18 * r + 3) / 3


pose = PoseEstimator(polar, "polar factor of the cross-products", "Horn et al. 1988")
pivot = PivotEstimator(one_step, "algebraic one step", "Yaniv 2015")
kernel = Kernel(wendland_c4, 1, 0, 2.0, "four times differentiable, zero beyond its scale", "Wendland 1995")
preset = Preset("a short talk, little turned", Parameters(frames=240, range_deg=(10.0, 15.0, 8.0)))
