"""Every proportion of the template, with its source.

All numbers are in mm in the frame of the ICT-FaceKit neutral face [1]_ (x to the person's left, y up, z
forward), measured on that face; it is the face on which the marker layouts of the synthetic performers were
placed, too. No vertex of it is stored here.

References
----------
.. [1] R. Li et al., "Learning Formation of Physically-Based Face Attributes", CVPR 2020; ICT-FaceKit,
   https://github.com/ICT-VGL/ICT-FaceKit, MIT licence, Copyright (c) 2020 USC Institute for Creative
   Technologies.
"""

from __future__ import annotations

import numpy as np

from evalkit.head.surface import Ellipsoid, Primitive, RoundCone

PRIMITIVES: tuple[Primitive, ...] = (
    Ellipsoid("cranium", (0.0, 63.6, -3.4), (79.9, 81.8, 90.0), (-0.22, 0.00, 0.00), 1.0),
    Ellipsoid("frontal bone", (0.0, 62.4, 53.6), (58.7, 62.5, 50.6), (-0.28, 0.00, 0.00), 39.9),
    Ellipsoid("temple", (54.8, 41.4, 42.6), (15.5, 41.4, 35.2), (-0.02, -0.22, 0.20), 14.0),
    Ellipsoid("mid face", (0.0, -8.9, 47.3), (67.2, 70.2, 52.5), (0.39, 0.00, 0.00), 21.6),
    RoundCone("neck", (0.0, -56.6, 6.2), (0.0, -174.3, -49.8), (37.2, 89.1), 40.0),
    RoundCone("throat", (0.0, -69.5, 36.5), (0.0, -161.3, 0.5), (27.6, 18.9), 16.2),
    RoundCone("sternomastoid", (14.3, 5.8, -7.7), (33.7, -164.3, 9.1), (50.3, 6.1), 40.0),
    Ellipsoid("floor of the mouth", (0.0, -55.9, 64.9), (40.3, 23.2, 47.7), (-0.34, 0.00, 0.00), 16.9),
    RoundCone("jaw", (53.5, -10.2, 24.5), (11.5, -65.1, 78.8), (11.7, 13.0), 26.6),
    Ellipsoid("chin", (0.0, -65.0, 94.1), (20.8, 14.1, 15.8), (0.00, 0.00, 0.00), 15.0),
    Ellipsoid("chin side", (14.5, -63.5, 84.1), (16.0, 10.5, 13.6), (0.12, 0.07, -0.02), 13.7),
    Ellipsoid("zygoma", (44.4, 8.1, 66.6), (16.4, 16.0, 20.2), (-0.02, -0.03, -0.02), 19.9),
    Ellipsoid("cheek", (29.2, -14.2, 79.7), (22.7, 31.5, 18.6), (-0.29, 0.18, -0.17), 21.4),
    Ellipsoid("jowl", (35.9, -40.3, 59.4), (15.7, 19.2, 23.8), (0.17, -0.29, 0.02), 26.8),
    Ellipsoid("muzzle", (0.0, -20.9, 87.4), (23.9, 23.9, 28.7), (-0.15, 0.00, 0.00), 7.3),
    RoundCone("brow ridge", (19.6, 58.1, 94.2), (48.0, 52.0, 80.6), (8.7, 10.8), 20.7),
    Ellipsoid("glabella", (0.0, 56.2, 94.6), (12.1, 12.1, 9.9), (-0.04, 0.00, 0.00), 12.4),
    Ellipsoid("orbit", (24.7, 33.2, 105.6), (14.1, 12.3, 14.2), (-0.12, -0.12, 0.02), 18.4, carve=True),
    Ellipsoid("inner canthus hollow", (13.7, 35.0, 105.3), (5.3, 8.1, 8.4), (0.01, 0.00, -0.04), 7.7, carve=True),
    Ellipsoid("temple hollow", (74.0, 59.9, 96.4), (21.0, 24.9, 23.8), (0.04, -0.06, 0.07), 14.6, carve=True),
    Ellipsoid("eye ball", (31.7, 35.1, 78.7), (13.9, 11.8, 16.7), (0.02, -0.02, -0.01), 3.2),
    Ellipsoid("upper lid", (30.6, 40.5, 84.0), (17.5, 7.1, 12.6), (-0.17, -0.02, 0.02), 4.4),
    Ellipsoid("lower lid", (30.0, 27.3, 84.7), (17.4, 7.3, 10.5), (-0.02, 0.14, 0.05), 4.3),
    RoundCone("nose bridge", (0.0, 38.4, 97.6), (0.0, 10.8, 116.4), (5.8, 8.5), 10.4),
    Ellipsoid("nose base", (0.0, 16.5, 84.7), (17.9, 21.7, 15.1), (0.20, 0.00, 0.00), 10.2),
    Ellipsoid("nose side", (9.2, 16.5, 103.4), (4.6, 13.3, 11.8), (-0.02, -0.43, 0.56), 7.4),
    Ellipsoid("nose tip", (0.0, 2.8, 123.8), (9.4, 9.2, 6.9), (-0.16, 0.00, 0.00), 7.0),
    Ellipsoid("nose tip dome", (8.1, 4.1, 119.7), (7.4, 7.5, 3.9), (-0.48, 0.63, -0.02), 4.4),
    Ellipsoid("wing", (16.1, -0.6, 110.5), (4.5, 7.0, 8.6), (-0.13, -0.12, -0.12), 6.4),
    RoundCone("columella", (0.0, -8.2, 111.8), (0.0, -5.2, 120.7), (5.7, 2.7), 7.2),
    Ellipsoid("wing groove", (21.0, 3.5, 116.7), (4.3, 10.0, 10.5), (0.00, -0.01, 0.15), 9.8, carve=True),
    Ellipsoid("upper lip", (0.0, -26.0, 110.0), (14.9, 6.3, 8.3), (0.03, 0.00, 0.00), 8.1),
    Ellipsoid("upper lip side", (12.3, -28.4, 104.5), (11.4, 5.5, 8.5), (-0.17, 0.12, -0.06), 5.0),
    Ellipsoid("lower lip", (0.0, -39.4, 108.8), (13.3, 5.7, 7.7), (0.10, 0.00, 0.00), 1.9),
    Ellipsoid("lower lip side", (9.4, -40.8, 106.3), (13.6, 6.8, 7.5), (0.00, 0.44, 0.04), 3.8),
    Ellipsoid("philtrum", (0.0, -16.6, 118.9), (3.3, 6.5, 3.1), (-0.10, 0.00, 0.00), 4.5, carve=True),
    Ellipsoid("fold under the lip", (0.0, -53.1, 121.9), (20.0, 4.1, 8.7), (-0.01, 0.00, 0.00), 7.2, carve=True),
    Ellipsoid("nasolabial", (22.0, -20.8, 96.2), (6.5, 14.8, 10.1), (-0.01, -0.26, 0.54), 8.1),
    Ellipsoid("cheek hollow", (61.8, -26.4, 104.3), (18.6, 21.1, 16.8), (0.10, 0.01, 0.04), 19.0, carve=True),
    # By hand, after the fit, which left out the nostrils: a floor for them, and the openings.
    Ellipsoid("floor of the nostril", (7.5, -4.5, 111.0), (5.0, 5.0, 6.0), (0.0, 0.0, 0.0), 5.0),
    Ellipsoid("nostril", (7.2, -8.6, 112.5), (2.6, 2.4, 4.0), (0.0, 0.0, 0.0), 4.0, carve=True),
)
"""The masses of the head and what is carved from them.

Chosen by hand after the anatomy; then places, sizes and blends of all but the last two were fitted by robust least
squares, so that the zero level passes through the skin of [1]_ in front of the ears (without ears, nostrils and
the insides of lids and lips; the openings of the eyes closed by a sphere of 16.4 mm about the middle of the
eyeball). ``tests/test_head.py`` measures the distance that is left.
"""

EYE_CENTRE = np.array([31.2, 36.1, 79.1])
EYE_RADIUS = 14.7
"""Left eyeball: the sphere through the rear half of the left eyeball of [1]_ (centre 31.24, 36.08, 79.10; radius
14.45), a quarter of a millimetre larger so that it stands for the cornea, too."""

JAW_AXIS = np.array([0.0, 18.0, 25.0])
"""A point of the hinge axis through both condyles: 5 mm below and 19 mm before the ear canals of [1]_."""

UPPER_TEETH = (
    # x, z of the arch, mm
    (0.0, 106.5), (4.4, 106.2), (11.0, 103.4), (16.2, 98.6), (20.3, 91.9), (22.8, 85.4), (25.2, 77.7), (27.0, 68.9),
    (28.8, 59.5),
)  # fmt: skip
UPPER_TEETH_Y = (-23.0, -35.2)
LOWER_TEETH = (
    (0.0, 103.5), (3.9, 103.3), (9.8, 101.3), (14.6, 96.9), (18.7, 90.6), (21.2, 84.2), (23.5, 76.3), (25.0, 68.1),
    (26.3, 59.5),
)  # fmt: skip
LOWER_TEETH_Y = (-46.5, -34.6)
"""Arches of the teeth and heights of gum and edge: outer surfaces of the tooth crowns of [1]_ (front teeth to second
molars, mean of each tooth's extent in x; its foremost z for the incisors)."""
