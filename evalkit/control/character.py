"""A head that a database's motion plays on: from displacements of markers to all its vertices, one blend a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.control.alignment import aligned_bases
from evalkit.control.database import Database
from evalkit.control.retargeting import Retargeting, retarget
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head

BASES = 25
"""Components of the markers' motion, as in section 4.2 of Chai, Xiao & Hodgins (2003)."""

ROWS = 20_000
"""Frames of a database that they are made from, evenly spaced: more of them change nothing that is seen."""


@dataclass(frozen=True, eq=False)
class Character:
    """A head, and how it moves with the markers of a database.

    Attributes
    ----------
    head : Head
    retargeting : Retargeting
    kept : float
        Part of the variance of the database's motion that the bases keep.
    """

    head: Head
    retargeting: Retargeting
    kept: float

    @classmethod
    def of(cls, database: Database, head: Head, bases: int = BASES, jacobian: bool = True) -> Character:
        """Prepare a head for a database; some seconds, once.

        Parameters
        ----------
        database : Database
        head : Head
            See :func:`evalkit.control.targets.target_head`.
        bases : int
            At most; fewer where the markers have fewer.
        jacobian : bool
            See :class:`evalkit.control.retargeting.Transfer`.

        Raises
        ------
        EvalkitError
            If the head or the database's markers do not allow it.
        """
        rows = np.unique(np.linspace(0, database.rows - 1, min(database.rows, ROWS)).round().astype(np.intp))
        moves = np.asarray(database.motions[rows], dtype=np.float64)
        most = min(len(rows) - 1, 3 * len(database.labels))
        if most < 1:
            raise EvalkitError(f"{database.folder}: {database.rows} frames are too few to play on a head")
        found = aligned_bases(moves, count=min(bases, most), rest_mm=database.rest_mm)
        # The mean is one of the bases: coefficients of displacements from the rest, and not from it, are blended.
        spanning = np.concatenate([found.mean[None], found.bases])
        made = retarget(database.labels, database.rest_mm, spanning, head, jacobian=jacobian)
        return cls(made.target, made, found.kept)

    def vertices(self, displacements_mm: ArrayLike, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Positions (F, V, 3), mm, in the head's axes for displacements (F, M, 3), mm, of the markers; NaN: at rest."""
        moves = np.nan_to_num(np.asarray(displacements_mm, dtype=np.float64))
        return self.retargeting.bases.vertices(self.coefficients(moves), out)

    def coefficients(self, displacements_mm: ArrayLike) -> Array:
        """Of the bases, (F, L), for displacements (F, M, 3), mm."""
        return self.retargeting.coefficients(displacements_mm)
