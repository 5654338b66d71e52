"""How far landmarks of real heads lie apart, for judging whether a head is one.

``real_heads.json`` holds the landmarks of ICT-FaceKit's neutral face and of its first eight identity modes (MIT). Heads
are drawn as that model defines them: neutral face plus modes with standard normal weights. With eight modes only, the
true spread is larger.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np

from evalkit.geometry import Array
from evalkit.seeds import generator

DRAWN = 2000


@lru_cache(maxsize=1)
def _drawn() -> tuple[tuple[str, ...], Array, Array]:
    """Landmark names, their mean places (N, 3), and drawn heads (DRAWN, N, 3) aligned to them, mm."""
    facts = json.loads(Path(__file__).with_name("real_heads.json").read_text(encoding="utf-8"))
    mean, modes = np.array(facts["mean"]), np.array(facts["modes"])
    weights = generator("real heads", seed=0).standard_normal((DRAWN, len(modes)))
    return tuple(facts["names"]), mean, aligned(mean + np.tensordot(weights, modes, axes=1), mean)


def proportions_mm(number: int) -> dict[str, Array]:
    """Where the landmarks of one drawn head lie, (3,) each, mm, from those of the mean head, as large as it.

    Parameters
    ----------
    number : int
        Of the head, from 0 to :data:`DRAWN` - 1.
    """
    names, mean, heads = _drawn()
    return dict(zip(names, heads[number] - mean, strict=True))


def aligned(points: Array, target: Array) -> Array:
    """Points (..., N, 3) moved, turned and scaled onto a target (N, 3) with the least squares error.

    References
    ----------
    Umeyama, IEEE PAMI 13, 1991, doi:10.1109/34.88573.
    """
    middle = target.mean(axis=0)
    a, b = points - points.mean(axis=-2, keepdims=True), target - middle
    u, s, vt = np.linalg.svd(np.swapaxes(a, -1, -2) @ b)
    sign = np.ones_like(s)
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    scale = (s * sign).sum(axis=-1) / (a**2).sum(axis=(-2, -1))
    return np.asarray(scale[..., None, None] * (a @ (u * sign[..., None, :] @ vt)) + middle)


def depth_among_real_heads(landmarks: Mapping[str, Array], names: tuple[str, ...]) -> dict[str, dict[str, float]]:
    """Depth of some landmarks beside that of real heads.

    All landmarks together are first brought onto those of the mean head by a similarity, as the real ones are.

    Parameters
    ----------
    landmarks : mapping of str to ndarray, shape (3,)
    names : tuple of str

    Returns
    -------
    dict
        Name -> ``off_mm``, forward of the mean; ``spread_mm``, standard deviation of the real ones; ``score``, the one
        over the other.
    """
    known, mean, heads = _drawn()
    common = [k for k, name in enumerate(known) if name in landmarks]
    moved = aligned(np.array([landmarks[known[k]] for k in common]), mean[common])
    real = heads[:, common] if len(common) == len(known) else aligned(heads[:, common], mean[common])
    out = {}
    for name in names:
        at = common.index(known.index(name))
        off, spread = float(moved[at, 2] - mean[common][at, 2]), float(real[:, at, 2].std())
        out[name] = {"off_mm": off, "spread_mm": spread, "score": off / spread}
    return out
