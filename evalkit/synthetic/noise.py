"""What a capture system adds to every sample: noise, white or correlated in time and between neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evalkit.seeds import generator

BLOCK = 65536
"""Frames handled at once, so that working memory stays small in long takes."""

REACH_MM = 30.0
"""Distance over which markers share noise: the shared part of two markers d apart is correlated by about
exp(-d^2 / (2 reach^2))."""


def add_noise(
    points: NDArray[np.float64],
    sigma: float,
    seed: int,
    steps: float = 0.0,
    shared: float = 0.0,
    sites: NDArray[np.float64] | None = None,
) -> None:
    """Add Gaussian noise of one level to every coordinate, in place.

    The draws do not depend on the level: twice the level is twice the same noise. The level is that of every
    single sample, whatever the correlation.

    In time the noise of each coordinate is a stationary autoregression of first order,
    ``n[i] = a n[i-1] + sqrt(1 - a^2) w[i]`` with ``a = exp(-1 / steps)``, whose correlation after k frames is a^k.
    Between markers, ``n = sqrt(1 - c) w + sqrt(c) W v``: c is the part of the variance that is shared, v a second
    white noise and W weights that fall with distance, of unit length for each marker.

    Parameters
    ----------
    points : ndarray, shape (F, M, 3)
        Positions, mm; changed.
    sigma : float
        Standard deviation per axis, mm.
    seed : int
        Seed.
    steps : float
        Correlation time, frames; 0 is white.
    shared : float
        Part of the variance shared with neighbours, 0 to 1.
    sites : ndarray, shape (M, 3)
        Where the markers sit, mm; needed if noise is shared.
    """
    if sigma == 0:
        return
    own, common = generator("noise", seed=seed), generator("noise", "shared", seed=seed)
    weights = None if shared == 0 or sites is None else _neighbour_weights(sites)
    memory = None
    for start in range(0, len(points), BLOCK):
        block = points[start : start + BLOCK]
        noise = own.standard_normal(block.shape)
        if weights is not None:
            noise *= np.sqrt(1.0 - shared)
            noise += np.sqrt(shared) * (weights @ common.standard_normal(block.shape))
        if steps > 0:
            noise, memory = _autoregression(noise, float(np.exp(-1.0 / steps)), memory)
        block += sigma * noise


def _neighbour_weights(sites: NDArray[np.float64]) -> NDArray[np.float64]:
    """W, shape (M, M): Gaussian in the distance, every row of unit length."""
    squares = ((sites[:, None] - sites) ** 2).sum(axis=2)
    # Two Gaussian weights of width r / sqrt 2 make a correlation of width r.
    weights = np.exp(-squares / REACH_MM**2)
    return np.asarray(weights / np.sqrt((weights**2).sum(axis=1, keepdims=True)))


def _autoregression(
    white: NDArray[np.float64], a: float, before: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Filter white noise along the frames; `before` is the last frame of the block before, if any."""
    from scipy.signal import lfilter

    gain = np.sqrt(1.0 - a * a)
    # The first frame of all is drawn from the stationary distribution: the draw itself.
    state = a * before if before is not None else (1.0 - gain) * white[0]
    filtered, _ = lfilter([gain], [1.0, -a], white, axis=0, zi=state[None])
    return filtered, filtered[-1].copy()
