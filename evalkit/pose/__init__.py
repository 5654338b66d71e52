"""Head pose per frame from the rigid markers: one file per estimator, one line each in the table below.

Examples
--------
>>> import evalkit
>>> take, truth = evalkit.synthesize("clean", frames=60)
>>> rigid = take.indices(truth.rigid)
>>> pose = evalkit.pose_estimators["svd"](truth.neutral[rigid], take.points[:, rigid])
>>> bool(abs(pose.rotations - truth.rotations).max() < 1e-9)
True
>>> evalkit.pose_estimators["translation-invariants"].source, evalkit.pose_estimators["translation-invariants"].markers
('Huang et al. 2000', 3)
"""

from evalkit.peers.pose import pose_peers
from evalkit.plugins import Table
from evalkit.pose.horn import horn
from evalkit.pose.model import Pose, PoseEstimator
from evalkit.pose.qcp import qcp
from evalkit.pose.reference import reference_pose
from evalkit.pose.robust import robust
from evalkit.pose.svd import svd
from evalkit.pose.translation_invariants import translation_invariants, translation_invariants_raw

OWN: dict[str, PoseEstimator] = {
    "svd": PoseEstimator(svd, "least squares by singular values, weights, any number of markers", "Kabsch 1976"),
    "horn": PoseEstimator(horn, "least squares by unit quaternions, eigenvector", "Horn 1987"),
    "qcp": PoseEstimator(qcp, "least squares by the quaternion polynomial, the fastest", "Theobald 2005"),
    "robust": PoseEstimator(robust, "Geman-McClure loss, for swapped or displaced markers", "Yang et al. 2020"),
    "translation-invariants": PoseEstimator(
        translation_invariants, "the paper's edge vectors, projected to a rotation", "Huang et al. 2000", markers=3
    ),
    "translation-invariants-raw": PoseEstimator(
        translation_invariants_raw,
        "the paper's own matrix, not orthogonal under noise",
        "Huang et al. 2000, Eq. (3)",
        markers=3,
        orthogonal=False,
    ),
}
"""The estimators of this package."""

pose_estimators = Table({**OWN, **pose_peers()}, "evalkit.pose", PoseEstimator)
"""Name to estimator, peers and plugins included; whoever lists or crosses methods takes them from here."""

__all__ = ["Pose", "PoseEstimator", "pose_estimators", "reference_pose"]
