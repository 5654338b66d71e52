"""Performers: who wears the markers, and where the neck pivot and the jaw axis of that face are.

The head frame has its axes along those of the world when the head is in its neutral pose: x to the
performer's left, y up, z forward, mm. Its origin is that of the ICT-FaceKit neutral face [1]_, about the
middle of the head between the jaw joints.

References
----------
.. [1] R. Li et al., "Learning Formation of Physically-Based Face Attributes", CVPR 2020; ICT-FaceKit,
   https://github.com/ICT-VGL/ICT-FaceKit, MIT licence.
.. [2] V. C. Chancey, D. Ottaviano, B. S. Myers, R. W. Nightingale, "A kinematic and anthropometric study of
   the upper cervical spine and the occipital condyles", Journal of Biomechanics 40(9), 2007, 1953-1959.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evalkit.seeds import generator
from evalkit.synthetic.layouts import LAYOUTS

EAR_CANAL = np.array([0.0, 23.0, 6.0])
"""Mid-point between the ear canals, mm, read off the same face."""

PIVOT = EAR_CANAL + np.array([0.0, -83.0, -6.0])
"""Neck pivot in the head frame, mm: about the joint between the third and fourth vertebra.

Seen from the ear canals, the occipital condyles lie 31 mm below and 18 mm behind, and the centre of rotation
between the first two vertebrae 47 mm below and 7 mm behind [2]_. Motions of some 20° are shared with the
vertebrae below these, so the one centre that stands for all is put 36 mm lower still, which is an assumption
and not a measurement. It is 175 mm from the centre of the forehead triangle.
"""

JAW_AXIS = EAR_CANAL + np.array([0.0, -5.0, 19.0])
"""A point of the jaw's hinge axis (parallel to x through the condyles, just before the ears), mm."""

STANDING_AT = np.array([140.0, 1520.0, 260.0])
"""World position of the head frame's origin, mm; the world's origin is on the floor, off to a side."""


@dataclass(frozen=True)
class Performer:
    """One performer in the head frame.

    Parameters
    ----------
    labels : tuple of str, length M
        Marker names.
    rigid : tuple of str
        The labels that are taken as rigid with the skull.
    sites : ndarray, shape (M, 3)
        Marker positions of the face at rest, mm.
    pivot : ndarray, shape (3,)
        Neck pivot, mm.
    jaw_axis : ndarray, shape (3,)
        A point of the jaw's hinge axis, which is parallel to x, mm.
    size : ndarray, shape (3,)
        Width, height and depth relative to the average face. ``sites / size`` is where the markers would be
        on the average face, for which the expressions are described.
    """

    labels: tuple[str, ...]
    rigid: tuple[str, ...]
    sites: NDArray[np.float64]
    pivot: NDArray[np.float64]
    jaw_axis: NDArray[np.float64]
    size: NDArray[np.float64]


def make_performer(layout: str = "paper-23", number: int = 0) -> Performer:
    """A performer wearing a marker layout.

    Parameters
    ----------
    layout : str
        Name in `evalkit.synthetic.layouts.LAYOUTS`.
    number : int
        0 is the average face above. Any other number is another person, the same whenever asked for: width,
        height and depth of the face vary by 4 % (standard deviation), each marker is stuck on 1.5 mm off its
        site within the frontal plane, and the pivot is 6 mm off per axis (2 mm sideways).

    Returns
    -------
    Performer
    """
    worn = LAYOUTS[layout]
    sites = np.array(list(worn.sites.values()))
    pivot, jaw_axis, size = PIVOT.copy(), JAW_AXIS.copy(), np.ones(3)
    if number:
        random = generator("performer", seed=number)
        size = 1 + 0.04 * random.standard_normal(3).clip(-2.5, 2.5)
        sites, pivot, jaw_axis = sites * size, pivot * size, jaw_axis * size
        pivot += random.normal(scale=(2.0, 6.0, 6.0))
        sites[:, :2] += random.normal(scale=1.5, size=(len(sites), 2))
    return Performer(tuple(worn.sites), worn.rigid, sites, pivot, jaw_axis, size)
