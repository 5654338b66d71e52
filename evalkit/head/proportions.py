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
    Ellipsoid("cranium", (0.0, 60.9, -3.5), (79.9, 84.3, 93.6), (-0.29, 0.00, 0.00), 1.0),
    Ellipsoid("frontal bone", (0.0, 65.4, 51.3), (58.2, 56.2, 51.0), (-0.22, 0.00, 0.00), 38.0),
    Ellipsoid("temple", (52.4, 42.9, 37.2), (15.7, 37.4, 34.1), (0.04, -0.15, 0.28), 18.6),
    Ellipsoid("mid face", (0.0, -7.9, 43.6), (67.4, 72.9, 56.2), (0.32, 0.00, 0.00), 33.7),
    RoundCone("neck", (0.0, -62.8, -1.0), (0.0, -177.6, -45.5), (47.1, 78.0), 40.0),
    RoundCone("throat", (0.0, -69.4, 38.0), (0.0, -160.9, 0.7), (26.3, 17.9), 19.6),
    RoundCone("sternomastoid", (33.7, -1.0, -15.1), (30.5, -165.6, 16.4), (26.7, 6.2), 40.0),
    Ellipsoid("floor of the mouth", (0.0, -53.5, 66.5), (43.4, 22.1, 43.3), (-0.31, 0.00, 0.00), 19.5),
    RoundCone("jaw", (50.0, -11.4, 23.4), (13.3, -64.5, 79.5), (12.4, 12.7), 31.5),
    Ellipsoid("chin", (0.0, -64.3, 93.8), (19.2, 14.3, 16.0), (0.03, 0.00, 0.00), 18.1),
    Ellipsoid("chin side", (13.7, -63.3, 85.6), (14.3, 11.0, 13.9), (0.09, 0.00, -0.03), 12.2),
    Ellipsoid("zygoma", (44.6, 9.5, 65.4), (16.8, 15.0, 19.9), (-0.01, -0.01, -0.02), 21.3),
    Ellipsoid("cheek", (32.3, -15.2, 78.8), (20.9, 25.9, 18.1), (-0.19, 0.05, 0.00), 27.6),
    Ellipsoid("jowl", (38.7, -37.7, 55.0), (16.5, 19.2, 21.0), (0.03, -0.10, -0.01), 20.5),
    Ellipsoid("muzzle", (0.0, -21.1, 86.3), (23.5, 24.0, 30.6), (-0.07, 0.00, 0.00), 15.2),
    RoundCone("brow ridge", (16.2, 58.4, 94.8), (50.4, 52.5, 80.1), (8.8, 10.7), 24.0),
    Ellipsoid("glabella", (0.0, 56.3, 94.8), (11.7, 12.2, 10.2), (-0.04, 0.00, 0.00), 11.7),
    Ellipsoid("orbit", (27.0, 33.6, 104.3), (16.0, 11.4, 12.9), (-0.08, -0.12, 0.05), 16.1, carve=True),
    Ellipsoid("inner canthus hollow", (14.7, 36.6, 106.2), (5.0, 8.8, 8.0), (0.01, 0.01, -0.04), 8.1, carve=True),
    Ellipsoid("temple hollow", (74.1, 59.2, 94.5), (20.4, 26.3, 23.4), (0.03, -0.04, 0.05), 16.2, carve=True),
    Ellipsoid("eye ball", (31.6, 35.8, 79.0), (14.1, 14.5, 16.4), (0.01, -0.02, 0.00), 4.3),
    Ellipsoid("upper lid", (31.6, 41.1, 83.7), (16.7, 7.0, 12.9), (-0.11, -0.01, 0.04), 4.8),
    Ellipsoid("lower lid", (30.4, 27.8, 84.0), (16.1, 6.2, 11.2), (0.05, 0.14, -0.01), 5.2),
    RoundCone("nose bridge", (0.0, 39.0, 98.5), (0.0, 9.9, 117.2), (5.6, 8.3), 10.7),
    RoundCone("nose side", (6.6, 25.6, 95.8), (14.2, 4.7, 111.4), (5.1, 4.0), 9.3),
    Ellipsoid("nose tip", (0.0, 2.3, 123.9), (9.0, 8.4, 7.0), (-0.07, 0.00, 0.00), 7.8),
    Ellipsoid("nose tip dome", (6.6, 3.4, 121.3), (6.0, 6.1, 5.0), (-0.11, 0.09, 0.01), 4.7),
    Ellipsoid("wing", (15.6, -0.9, 111.1), (4.7, 7.4, 9.7), (-0.04, -0.10, -0.10), 7.7),
    RoundCone("columella", (0.0, -8.1, 111.9), (0.0, -3.8, 122.1), (4.6, 3.6), 5.4),
    Ellipsoid("nose flank", (5.7, 15.4, 107.2), (5.8, 7.4, 8.8), (0.05, -0.01, 0.00), 6.1),
    Ellipsoid("wing groove", (20.3, 3.5, 120.2), (2.0, 8.0, 8.9), (0.03, 0.35, 0.01), 13.4, carve=True),
    Ellipsoid("upper lip", (0.0, -26.8, 109.6), (10.6, 5.4, 9.3), (-0.09, 0.00, 0.00), 5.2),
    Ellipsoid("upper lip side", (11.0, -27.5, 105.7), (12.3, 4.8, 8.7), (-0.13, 0.17, -0.10), 7.4),
    Ellipsoid("lower lip", (0.0, -38.3, 107.4), (11.0, 5.0, 8.2), (0.01, 0.00, 0.00), 2.0),
    Ellipsoid("lower lip side", (9.3, -40.8, 106.6), (13.8, 6.5, 7.7), (-0.07, 0.44, 0.02), 4.4),
    Ellipsoid("lip corner", (28.9, -33.7, 96.5), (5.3, 5.1, 4.7), (0.02, 0.00, 0.00), 5.5),
    Ellipsoid("philtrum", (0.0, -17.7, 118.9), (2.7, 6.7, 3.1), (-0.11, 0.00, 0.00), 4.2, carve=True),
    Ellipsoid("fold under the lip", (0.0, -54.6, 123.1), (19.9, 4.0, 8.7), (-0.02, 0.00, 0.00), 7.4, carve=True),
    Ellipsoid("nasolabial", (23.1, -17.3, 97.2), (6.0, 15.4, 6.5), (-0.28, -0.03, 0.20), 7.5),
    Ellipsoid("cheek hollow", (63.3, -24.5, 101.1), (17.9, 21.5, 17.4), (0.05, 0.00, 0.03), 20.1, carve=True),
)
"""The masses of the head and what is carved from them.

Chosen by hand after the anatomy, then their sizes fitted by robust least squares so that the zero level passes
through the skin of [1]_ in front of the ears (without ears, nostrils and the insides of lids and lips; the
openings of the eyes closed by a sphere of 16.4 mm about the middle of the eyeball). ``tests/test_head.py``
measures the distance that is left.
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
