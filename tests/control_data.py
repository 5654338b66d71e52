"""A small database of control and signals for tests of filter, synthesis and stream, made without any face.

A state of a few smooth numbers drives both parameters and markers, not quite linearly.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from evalkit.seeds import generator

RATE_HZ = 60.0
MARKERS = 7


def performed(seed, frames, rate_hz=RATE_HZ):
    """Parameters (F, 15) with a spread of about one, and displacements (F, 7, 3), mm, of one performance."""
    random = generator("control data", seed=seed)
    times = np.arange(frames) / rate_hz
    speeds, phases = random.uniform(0.2, 1.2, (4, 3)), random.uniform(0, 2 * np.pi, (4, 3))
    state = np.sin(2 * np.pi * speeds[:, :, None] * times + phases[..., None]).sum(axis=1).T
    own = generator("control data", "face")
    parameters = state @ own.normal(size=(4, 15)) * 0.4 + 0.1 * (state**2) @ own.normal(size=(4, 15))
    motions = (2.0 * state @ own.normal(size=(4, 3 * MARKERS))).reshape(frames, MARKERS, 3)
    return parameters, motions


def database(rows=1200, takes=3, unknown=(), rate_hz=RATE_HZ):
    """Takes of one performer, each a segment."""
    found = [performed(seed, rows) for seed in range(takes)]
    parameters = np.concatenate([p for p, _ in found]).astype(np.float32)
    known = np.ones(15, dtype=bool)
    known[list(unknown)] = False
    parameters[:, ~known] = 0.0
    edges = np.arange(takes + 1) * rows
    return SimpleNamespace(
        parameters=parameters,
        known=known,
        motions=np.concatenate([m for _, m in found]).astype(np.float32),
        segments=np.column_stack([edges[:-1], edges[1:]]),
        rate_hz=rate_hz,
    )
