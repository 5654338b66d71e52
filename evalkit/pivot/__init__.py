"""Centre of rotation of the head: one file per family of estimators, one line each in the table below.

Examples
--------
>>> import evalkit
>>> take, truth = evalkit.synthesize("clean", frames=60)
>>> rigid = take.indices(truth.rigid)
>>> points = take.points[:, rigid]
>>> pose = evalkit.pose_estimators["svd"](truth.neutral[rigid], points)
>>> pivot = evalkit.pivot_estimators["score"](points, pose, initial=points.mean(axis=(0, 1)), reference="mean")
>>> pivot.status, pivot.position.round(3)
('ok', array([ 140., 1460.,  260.]))
>>> truth.pivot
array([ 140., 1460.,  260.])
"""

from evalkit.peers.pivot import pivot_peers
from evalkit.pivot.algebraic import score, svd
from evalkit.pivot.joint import joint
from evalkit.pivot.model import Pivot, PivotEstimator
from evalkit.pivot.nlopt_search import entries
from evalkit.pivot.six_directions import six_directions
from evalkit.pivot.sphere import gamage_lasenby, sphere
from evalkit.plugins import Table

OWN: dict[str, PivotEstimator] = {
    "joint": PivotEstimator(
        joint, "maximum likelihood of shape, pivot, sway and rotations", "this package; Triggs et al. 2000", turns=True
    ),
    "score": PivotEstimator(score, "symmetric least squares of the poses, bias corrected", "Ehrig et al. 2006"),
    "svd": PivotEstimator(svd, "least squares of (I - R) O = T", "Ehrig et al. 2006"),
    "sphere": PivotEstimator(sphere, "geometric sphere fit, least squares of the distances", "Halvorsen et al. 1999"),
    "gamage-lasenby": PivotEstimator(gamage_lasenby, "closed-form sphere fit, bias corrected", "Halvorsen 2003"),
    "six-directions": PivotEstimator(six_directions, "the paper's objective and search", "Huang et al. 2000"),
    **entries(),
}
"""The estimators of this package."""

pivot_estimators = Table({**OWN, **pivot_peers()}, "evalkit.pivot", PivotEstimator)
"""Name to estimator, peers and plugins included; whoever lists or crosses methods takes them from here."""

__all__ = ["Pivot", "PivotEstimator", "pivot_estimators"]
