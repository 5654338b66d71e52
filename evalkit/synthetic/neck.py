"""The neck: the slow sway of the body that carries the pivot, and the second joint of a neck of two.

In a neck of two joints the head nods about one centre and turns and tilts about another, the pivot O. The three
hinges are carried by one another: turn carries nod, nod carries tilt. With ``Q_c(x) = Q (x - c) + c`` a turn about
the centre c and N the centre of the nod, a point of the head frame goes to

    ``R_y|O ( R_x|N ( R_z|O (p) ) ) = R (p - O) + O + j,    R = R_y R_x R_z,    j = R_y (I - R_x) (N - O)``.

So the rotation is that of a neck of one joint, and what the second joint adds to the translation is the path j of
the pivot. It is added to the sway s: ``T = (I - R) O + s`` holds as ever.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.seeds import generator
from evalkit.synthetic.motion import hum

SWAY_SHARE = np.array([1.0, 0.4, 0.8])
"""Relative size of the sway along x, y and z: a standing body sways sideways and to and fro, less up."""


def neck_sway(times: NDArray[np.float64], size: float, fastest: float, seed: int) -> NDArray[np.float64]:
    """Slow translation of the pivot.

    Parameters
    ----------
    times : ndarray, shape (F,)
        Time of every frame, s.
    size : float
        Largest distance of the pivot from its mean place, mm; 0 gives exact zeros.
    fastest : float
        Upper end of the sway's band, Hz.
    seed : int
        Seed.

    Returns
    -------
    ndarray, shape (F, 3)
        Sway s, mm, with zero mean over the frames.
    """
    sway = np.zeros((len(times), 3))
    if size == 0:
        return sway
    for axis in range(3):
        random = generator("sway", "xyz"[axis], seed=seed)
        sway[:, axis] = SWAY_SHARE[axis] * hum(times, (0.1 * fastest, fastest), random, tones=6)
    sway -= sway.mean(axis=0)
    largest = np.sqrt((sway**2).sum(axis=1)).max()
    if largest > 0:
        sway *= size / largest
        sway -= sway.mean(axis=0)  # takes the last rounding out of the mean
    return sway


def second_joint(angles_deg: NDArray[np.float64], gap_mm: float) -> NDArray[np.float64]:
    """Path of the pivot j when the head nods about a centre straight above it.

    Parameters
    ----------
    angles_deg : ndarray, shape (F, 3)
        Nod, turn, tilt, deg.
    gap_mm : float
        How far the centre of the nod lies above that of turn and tilt, mm; negative below.

    Returns
    -------
    ndarray, shape (F, 3)
        j = R_y (I - R_x) (0, gap, 0), mm; 0 in the neutral pose, so its mean is not.
    """
    nod, turn = np.deg2rad(angles_deg[:, 0]), np.deg2rad(angles_deg[:, 1])
    back = -gap_mm * np.sin(nod)
    return np.column_stack([back * np.sin(turn), gap_mm * (1.0 - np.cos(nod)), back * np.cos(turn)])
