"""From markers to vertices: kernels, one linear map per rest pose, regions, scaling, playing it."""

from evalkit.deform.apply import Deformer
from evalkit.deform.kernels import Kernel
from evalkit.deform.map import Deformation, deformation_map, deformation_report, fill_missing
from evalkit.deform.regions import seam_jump, seam_treatments
from evalkit.deform.scaling import Scaling, performer_scaling

__all__ = [
    "Deformation",
    "Deformer",
    "Kernel",
    "Scaling",
    "deformation_map",
    "deformation_report",
    "fill_missing",
    "performer_scaling",
    "seam_jump",
    "seam_treatments",
]
