"""Heads that a performance can be put on, and what they must have for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.head import Head, load_head
from evalkit.head.importing import import_head, regions_by_place
from evalkit.head.places import NEEDED_LANDMARKS

IDENTITY = "identity"
"""Shapes of a head whose name begins so change who it is, and not what it does."""


def target_head(source: str | Path, names: str | Path | None = None, identity: str | None = None) -> Head:
    """A head by its name or file.

    Parameters
    ----------
    source : str or Path
        What :func:`evalkit.load_head` takes: ``template``, ``makehuman``, the folder of ``evalkit head fit``, a mesh
        file of others with its JSON of names, ``mediapipe_canonical_face.obj``; or ICT-FaceKit's arrays (``.npz``).
    names : str or Path, optional
        JSON of landmarks of a mesh file, where it does not lie beside it.
    identity : str, optional
        Shape of the head that makes it another person, such as ``identity003`` of ICT-FaceKit.

    Raises
    ------
    EvalkitError
        If there is no such head or identity, or it lacks landmarks.
    """
    path = Path(source)
    if names is not None:
        head = import_head(path, names)
    elif path.suffix == ".npz" and path.is_file() and not _is_head(path):
        head = import_head(path)
    else:
        head = load_head(source)
    return checked_target(head if identity is None else as_identity(head, identity))


def _is_head(path: Path) -> bool:
    """Whether an ``.npz`` is one of :meth:`Head.save`; one that cannot be read is left to :func:`evalkit.load_head`."""
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            return "facts" in file.files
    except Exception:
        # A zip that is cut short: numpy raises a dozen different errors.
        return True


def as_identity(head: Head, identity: str, amount: float = 1.0) -> Head:
    """A head as the person that one of its shapes makes of it; places ride on the vertices nearest to them.

    Raises
    ------
    EvalkitError
        If it has no such shape.
    """
    if identity not in head.blendshapes:
        known = [name for name in head.blendshapes if name.startswith(IDENTITY)]
        raise EvalkitError(f"{head.name}: no identity '{identity}'; it has {', '.join(known[:10]) or 'none'}")
    moved = head.posed(units={identity: amount})
    off = moved - head.vertices
    places = []
    for where in (head.landmarks, head.marker_sites):
        near = head.nearest_vertices(where)
        places.append({name: place + off[near[name]] for name, place in where.items()})
    return replace(head, name=f"{head.name}, {identity}", vertices=moved, landmarks=places[0], marker_sites=places[1])


def checked_target(head: Head) -> Head:
    """The head with regions of its lips, or one line on what it lacks.

    Raises
    ------
    EvalkitError
        If a landmark of :data:`evalkit.head.places.NEEDED_LANDMARKS` is missing.
    """
    missing = [name for name in NEEDED_LANDMARKS if name not in head.landmarks]
    if missing:
        raise EvalkitError(
            f"{head.name}: cannot be a target, {len(missing)} of {len(NEEDED_LANDMARKS)} landmarks are missing "
            f"({', '.join(missing)}); name them in a JSON beside the mesh: "
            '{"landmarks": {"nose tip": 1225, "chin": [0.0, -75.7, 104.3], ...}}, vertex numbers or positions'
        )
    if all(len(head.regions.get(lip, ())) for lip in ("upper lip", "lower lip")):
        return head
    regions = regions_by_place(head.vertices, head.triangles, head.landmarks)
    soft = head.soft_vertices
    return replace(head, regions={name: np.intersect1d(which, soft) for name, which in regions.items()})
