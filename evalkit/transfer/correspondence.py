"""Which triangles of two registered meshes belong together, as a file that can be kept."""

from __future__ import annotations

import contextlib
import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError
from evalkit.head.makehuman import cache_folder
from evalkit.transfer.gradients import Indices
from evalkit.transfer.registration import MINGLE, Surface, matching, register

CANDIDATES = 24
"""So many near triangles are tried for one that faces the same way and has a label that may be met."""

FORMAT = 1

MOST_KEPT = 12
"""Files of this kind in the user's cache, the newest; under a megabyte each."""


@dataclass(frozen=True, eq=False)
class Correspondence:
    """Pairs of triangles.

    Attributes
    ----------
    source, target : ndarray of int, shape (P,)
        Triangles that belong together. A triangle may have several partners; every target triangle has one at least.
    source_hash, target_hash : str
        Of both topologies; see :func:`topology_hash`.
    """

    source: Indices
    target: Indices
    source_hash: str
    target_hash: str

    def check(self, source_triangles: Indices, target_triangles: Indices, name: str = "correspondence") -> None:
        """Raise an EvalkitError unless it was made for these meshes and leaves no target triangle without a partner."""
        for triangles, known, whose in (
            (source_triangles, self.source_hash, "source"),
            (target_triangles, self.target_hash, "target"),
        ):
            if topology_hash(triangles) != known:
                raise EvalkitError(f"{name}: was made for another {whose} mesh; make it anew for these two")
        if self.source.shape != self.target.shape or self.source.ndim != 1:
            raise EvalkitError(f"{name}: {self.source.shape} source and {self.target.shape} target triangles; no pairs")
        for which, count, whose in (
            (self.source, len(source_triangles), "source"),
            (self.target, len(target_triangles), "target"),
        ):
            bad = np.flatnonzero((which < 0) | (which >= count))
            if len(bad):
                raise EvalkitError(f"{name}: pair {bad[0]} names {whose} triangle {which[bad[0]]}, of {count}")
        alone = np.setdiff1d(np.arange(len(target_triangles)), self.target)
        if len(alone):
            raise EvalkitError(f"{name}: target triangle {alone[0]} has no partner ({len(alone)} such)")

    def save(self, path: str | Path) -> None:
        """Write one ``.npz`` file, complete or not at all.

        Raises
        ------
        EvalkitError
            If the file cannot be written.
        """
        path = Path(path)
        temporary = path.with_name(path.name + ".part")
        try:
            with temporary.open("wb") as file:
                np.savez_compressed(
                    file, format=FORMAT, source=self.source, target=self.target, source_hash=self.source_hash,
                    target_hash=self.target_hash,
                )  # fmt: skip
            temporary.replace(path)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise EvalkitError(f"{path}: cannot write the correspondence ({error.strerror or error})") from error


def read_correspondence(path: str | Path, source_triangles: Indices, target_triangles: Indices) -> Correspondence:
    """Read what :meth:`Correspondence.save` has written, or a user's file of the same arrays.

    Raises
    ------
    EvalkitError
        If there is no such file, it is none, or it was made for other meshes.
    """
    path = Path(path)
    if not path.is_file():
        raise EvalkitError(f"{path}: no such file")
    try:
        # numpy leaves a file open that it opened itself and then could not read.
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            if int(file["format"]) != FORMAT:
                raise EvalkitError(f"{path}: format {int(file['format'])} is not known here ({FORMAT} is)")
            out = Correspondence(
                file["source"].astype(np.intp), file["target"].astype(np.intp), str(file["source_hash"]),
                str(file["target_hash"]),
            )  # fmt: skip
    except EvalkitError:
        raise
    except Exception as error:
        # A zip that is cut short or something else altogether: numpy raises a dozen different errors.
        raise EvalkitError(f"{path}: not a correspondence file ({type(error).__name__})") from error
    out.check(source_triangles, target_triangles, str(path))
    return out


def topology_hash(triangles: Indices) -> str:
    """Of the numbers of the vertices of all triangles, in their order."""
    return hashlib.sha256(np.ascontiguousarray(triangles, dtype="<i8").tobytes()).hexdigest()


def same_topology(triangles: Indices) -> Correspondence:
    """Each triangle with itself: two meshes of one topology."""
    number, known = np.arange(len(triangles)), topology_hash(triangles)
    return Correspondence(number, number, known, known)


def corresponding(source: Surface, target: Surface) -> Correspondence:
    """Corresponding triangles of two meshes by their landmarks; what was found before comes out of the user's cache.

    The coarser mesh is the one that is bent onto the other, whichever is the source: its size sets the time.

    Parameters
    ----------
    source, target : Surface

    Returns
    -------
    Correspondence

    Raises
    ------
    EvalkitError
        As :func:`evalkit.transfer.registration.register`.
    """
    with contextlib.suppress(EvalkitError):
        return read_correspondence(_kept(source, target), source.triangles, target.triangles)
    bent, other = sorted((source, target), key=lambda one: len(one.vertices))
    moved = replace(bent, vertices=register(bent, other))
    there, back = correspondence_of(moved, other), correspondence_of(other, moved)
    # One registration serves both directions.
    _keep(there, _kept(bent, other))
    _keep(back, _kept(other, bent))
    return there if bent is source else back


def _keep(found: Correspondence, path: Path) -> None:
    """Write to the cache, if it can be written."""
    with contextlib.suppress(EvalkitError, OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        # Processes that register the same meshes at once each write a file of their own.
        own = path.with_name(f".{os.getpid()}-{path.name}")
        found.save(own)
        own.replace(path)
        for old in sorted(path.parent.glob("correspondence-*.npz"), key=lambda file: file.stat().st_mtime)[:-MOST_KEPT]:
            old.unlink(missing_ok=True)


def _kept(source: Surface, target: Surface) -> Path:
    """File named by all that a correspondence follows from: both surfaces, the code, NumPy and SciPy."""
    import scipy

    digest = hashlib.sha256(f"{np.__version__} {scipy.__version__}".encode())
    for name in ("correspondence", "registration", "gradients", "matrices", "solver"):
        digest.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    for one in (source, target):
        for name, place in sorted(one.landmarks.items()):
            digest.update(f"{name} {np.asarray(place, dtype=np.float64).tolist()} ".encode())
        labels = "" if one.labels is None else "/".join(one.labels)
        digest.update(f"{one.vertices.shape} {topology_hash(one.triangles)} {labels} ".encode())
        digest.update(np.ascontiguousarray(one.vertices, dtype="<f8").tobytes())
    return cache_folder() / f"correspondence-{digest.hexdigest()[:16]}.npz"


def correspondence_of(
    registered: Surface, target: Surface, *, both: bool = True, mingle: tuple[tuple[str, str], ...] = MINGLE
) -> Correspondence:
    """Triangles with the nearest centroids, among those that face the same way and have labels that may be matched.

    Parameters
    ----------
    registered : Surface
        The source, its vertices where :func:`evalkit.transfer.registration.register` has put them.
    target : Surface
    both : bool
        Whether each source triangle brings its nearest target triangle in too, as in the paper; else only each target
        triangle its nearest source triangle.
    mingle : tuple of pairs of str
        Different labels that may be matched.

    Returns
    -------
    Correspondence

    References
    ----------
    Sumner and Popovic 2004, doi:10.1145/1015706.1015736, section 4.2.
    """
    a, b = _Faces(registered), _Faces(target)
    source, ends = b.nearest_in(a, mingle, always=True), np.arange(len(target.triangles))
    if both:
        partner = a.nearest_in(b, mingle, always=False)
        has = np.flatnonzero(partner >= 0)
        pairs = np.unique(np.stack([np.r_[ends, partner[has]], np.r_[source, has]], axis=1), axis=0)
        ends, source = pairs[:, 0], pairs[:, 1]
    return Correspondence(source, ends, topology_hash(registered.triangles), topology_hash(target.triangles))


class _Faces:
    """Centroid, unit normal and label of each triangle."""

    def __init__(self, surface: Surface) -> None:
        corners = surface.vertices[surface.triangles]
        self.centre = corners.mean(axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        self.normal = normal / np.where(length > 0.0, length, 1.0)
        self.label: NDArray[np.str_] | None = None
        if surface.labels is not None:
            # The kind of two of three corners; where all three differ, any.
            self.label = np.sort(np.asarray(surface.labels)[surface.triangles], axis=1)[:, 1]

    def nearest_in(self, other: _Faces, mingle: tuple[tuple[str, str], ...], *, always: bool) -> Indices:
        """Nearest triangle of the other for each, (T,); -1, or with `always` the nearest of all, if none fits.

        Where none of the near ones fits, all of the same label are tried.
        """
        from scipy.spatial import cKDTree

        _, near = cKDTree(other.centre).query(self.centre, k=min(CANDIDATES, len(other.centre)))
        near = near.reshape(len(self.centre), -1)
        fits = np.einsum("ti,tki->tk", self.normal, other.normal[near]) > 0.0
        known = self.label is not None and other.label is not None
        if known:
            fits &= matching(self.label[:, None], other.label[near], mingle)  # type: ignore[index]
        out = np.where(fits.any(axis=1), near[np.arange(len(near)), fits.argmax(axis=1)], -1)
        if always:
            for label in np.unique(self.label[out < 0]) if known else ():  # type: ignore[index]
                lost = np.flatnonzero((out < 0) & (self.label == label))
                kind = np.flatnonzero(matching(np.asarray(label), other.label, mingle))  # type: ignore[arg-type]
                if len(kind):
                    out[lost] = kind[cKDTree(other.centre[kind]).query(self.centre[lost])[1]]
            out = np.where(out < 0, near[:, 0], out)
        return out.astype(np.intp)
