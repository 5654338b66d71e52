"""Slow, obvious versions of filter, synthesis and the putting together of windows: one window, one frame at a time."""

from __future__ import annotations

import math

import numpy as np


def projected_slow(window, neighbours, kept):
    """A window on the plane through its neighbours, by the singular value decomposition of the neighbours."""
    mean = neighbours.mean(axis=0)
    _, strength, axes = np.linalg.svd(neighbours - mean, full_matrices=False)
    power = strength**2
    count = 1
    while power[:count].sum() < kept * power.sum():
        count += 1
    out = mean.copy()
    for axis in axes[:count]:
        out += ((window - mean) @ axis) * axis
    return out


def posterior_slow(window, mean, covariance, noise):
    """Mean of a Gaussian given what is known of a noisy draw: conditioning by the whole covariance of what is known."""
    known = [k for k in range(len(window)) if math.isfinite(window[k])]
    seen = covariance[np.ix_(known, known)] + np.diag(noise[known])
    return mean + covariance[:, known] @ np.linalg.inv(seen) @ (window[known] - mean[known])


def inverse_distance_slow(window, examples):
    """Weights 1/d - 1/d_K over their sum."""
    distances = [math.dist(window, example) for example in examples]
    raw = [1.0 / distance - 1.0 / max(distances) for distance in distances]
    return [value / sum(raw) for value in raw]


def cross_blended(values, step, blend):
    """Windows (n, W) that overlap by ``blend`` samples, one after the other, as the paper blends them."""
    count, width = len(values), len(values[0])
    out = [0.0] * ((count - 1) * step + width)
    for number, window in enumerate(values):
        for sample, value in enumerate(window):
            weight = 1.0
            if number > 0 and sample < blend:
                weight = 1.0 - (0.5 * math.cos(math.pi * (sample + 1) / (blend + 1)) + 0.5)
            if number < count - 1 and sample >= width - blend:
                weight = 0.5 * math.cos(math.pi * (sample - (width - blend) + 1) / (blend + 1)) + 0.5
            out[number * step + sample] += weight * value
    return out
