"""Random streams named by what they are for, so that results do not depend on the order of the work."""

from __future__ import annotations

import hashlib
from numbers import Integral

import numpy as np

from evalkit.errors import EvalkitError

LARGEST_SEED = 2**63 - 1
"""Largest seed accepted: one that fits a signed 64-bit integer in any file or table."""


def seed_sequence(*names: object, seed: int = 0) -> np.random.SeedSequence:
    """The seed sequence of the stream with these names.

    The names are those of a study's axes (method, preset, noise level, ...) or of the parts of a synthetic
    take. They are hashed by SHA-256 over their text, not by Python's `hash`, so that a stream is the same
    in every process, on every platform and in whichever order or on whichever worker the cells run.

    Parameters
    ----------
    *names : object
        Names of the stream; each counts by its text, so ``0.3`` and ``"0.3"`` are the same name.
    seed : int
        Seed, 0 to 2^63 - 1. Different seeds give independent streams under the same names.

    Returns
    -------
    numpy.random.SeedSequence

    Raises
    ------
    EvalkitError
        If the seed is not an integer in that range.
    """
    if isinstance(seed, bool) or not isinstance(seed, Integral) or not 0 <= seed <= LARGEST_SEED:
        raise EvalkitError(f"seed {seed!r} is not a whole number from 0 to 2^63 - 1")
    digest = hashlib.sha256()
    for name in names:
        text = str(name).encode()
        # The length goes first: ("a", "bc") and ("ab", "c") are different streams.
        digest.update(len(text).to_bytes(8, "little"))
        digest.update(text)
    words = np.frombuffer(digest.digest(), dtype="<u4")
    return np.random.SeedSequence([int(seed), *(int(word) for word in words)])


def generator(*names: object, seed: int = 0) -> np.random.Generator:
    """A random generator (PCG64) on the stream with these names; see `seed_sequence`."""
    return np.random.Generator(np.random.PCG64(seed_sequence(*names, seed=seed)))
