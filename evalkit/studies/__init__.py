"""Studies: what the methods are worth on takes whose truth is known, one file each."""

from evalkit.studies.bold_driver import study as bold_driver
from evalkit.studies.capture_rate import study as capture_rate
from evalkit.studies.covariance_calibration import study as covariance_calibration
from evalkit.studies.gaps import study as gaps
from evalkit.studies.marker_layout import study as marker_layout
from evalkit.studies.objective_terms import study as objective_terms
from evalkit.studies.optimisers import study as optimisers
from evalkit.studies.outliers import study as outliers
from evalkit.studies.pivot_noise import study as pivot_noise
from evalkit.studies.pivot_range_of_motion import study as pivot_range_of_motion
from evalkit.studies.pivot_sway import study as pivot_sway
from evalkit.studies.pose_noise import study as pose_noise
from evalkit.studies.real_takes import study as real_takes
from evalkit.studies.scaling import study as scaling
from evalkit.studies.skin import study as skin
from evalkit.studies.two_joint_neck import study as two_joint_neck
from evalkit.study.description import Study

studies: dict[str, Study] = {
    study.name: study
    for study in (
        pivot_noise,
        pivot_range_of_motion,
        pivot_sway,
        covariance_calibration,
        objective_terms,
        optimisers,
        bold_driver,
        pose_noise,
        gaps,
        outliers,
        skin,
        two_joint_neck,
        marker_layout,
        capture_rate,
        real_takes,
        scaling,
    )
}
"""Name to study; the command line and the tests take their lists from here."""
