"""The head: a mesh at rest with names for its places, and how its jaw and lids move.

Axes: x to the person's left, y up, z forward, mm; the origin is about the middle of the head between the jaw
joints. A head is soft where it has skin (the parts :data:`SOFT`) and rigid elsewhere.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import EvalkitError
from evalkit.geometry import Array

Indices = NDArray[np.intp]

REGIONS = ("hindbrain", "neck", "face", "upper lip", "lower lip")
"""Every soft vertex is in exactly one of these."""

SOFT = ("skin", "lids", "mouth pocket")
"""Parts that a face's motion deforms. Teeth, eyeballs, ears, tongue and plate stay as they are."""

JAW_LIMIT_DEG = 30.0
"""The jaw opens so far."""

VIEW_LIMIT_DEG = 30.0
"""A mask with a plate behind it looks right up to this angle between its forward axis and the camera."""

FORMAT = 1


@dataclass(frozen=True)
class Jaw:
    """The hinge of the jaw: an axis parallel to x through both condyles, and how far each vertex follows.

    Attributes
    ----------
    axis : ndarray, shape (3,), mm
        A point of the axis.
    weights : ndarray, shape (V,)
        Share of the jaw's angle by which a vertex turns about the axis, 0 to 1.
    """

    axis: Array
    weights: Array


@dataclass(frozen=True)
class Lids:
    """How the upper lids slide down along the eyeballs.

    Attributes
    ----------
    centres : ndarray, shape (2, 3), mm
        Middles of the left and the right eyeball.
    radius : float, mm
        Of the eyeballs.
    eye : ndarray of int, shape (V,)
        Which eyeball a vertex slides along, -1 for none.
    turn : ndarray, shape (V,), rad
        Angle about the axis through the eyeball parallel to x when the lid is closed.
    lift : ndarray, shape (V,), mm
        Change of the distance from the middle of the eyeball when the lid is closed.
    """

    centres: Array
    radius: float
    eye: Indices
    turn: Array
    lift: Array


@dataclass(frozen=True, eq=False)
class Head:
    """A head at rest.

    Attributes
    ----------
    name : str
    vertices : ndarray, shape (V, 3), mm
    triangles : ndarray of int, shape (T, 3)
        Counter-clockwise seen from outside.
    parts : dict of str to (int, int)
        Ranges of triangles (first, one past the last) that together make up the mesh.
    regions : dict of str to ndarray of int
        Vertex indices, a partition of the soft vertices; names are :data:`REGIONS`.
    landmarks, marker_sites : dict of str to ndarray, shape (3,), mm
        Places on the skin at rest; :meth:`nearest_vertices` gives the vertices that stand for them.
    jaw : Jaw, optional
    lids : Lids, optional
    uv : ndarray, shape (V, 2), optional
        Texture coordinates, v upward.
    texture : ndarray of uint8, shape (H, W, 4), optional
        Red, green, blue and opacity, first row on top (v = 1).
    blendshapes : dict of str to (ndarray of int (N,), ndarray (N, 3))
        Vertices that a named unit moves, and their displacements, mm.
    source : str
        Where the mesh comes from, and its licence.
    provenance : dict
        What else it was made from, as JSON can hold: the photo and the points of a fitted head.

    Examples
    --------
    How far the vertices that stand for the marker sites lie from them, mm:

    >>> import numpy as np
    >>> import evalkit
    >>> head = evalkit.load_head("template")
    >>> near = head.nearest_vertices(head.marker_sites)
    >>> off = [np.linalg.norm(head.vertices[near[name]] - place) for name, place in head.marker_sites.items()]
    >>> round(float(max(off)), 1)
    1.9
    """

    name: str
    vertices: Array
    triangles: Indices
    parts: dict[str, tuple[int, int]]
    regions: dict[str, Indices]
    landmarks: dict[str, Array]
    marker_sites: dict[str, Array]
    jaw: Jaw | None = None
    lids: Lids | None = None
    uv: Array | None = None
    texture: NDArray[np.uint8] | None = None
    blendshapes: dict[str, tuple[Indices, Array]] = field(default_factory=dict)
    source: str = ""
    provenance: dict[str, Any] = field(default_factory=dict)

    def part_triangles(self, *names: str) -> Indices:
        """Triangles (N, 3) of some parts; parts that this head lacks count as empty."""
        ranges = [self.parts[name] for name in names if name in self.parts]
        return np.concatenate([np.zeros((0, 3), dtype=np.intp), *(self.triangles[a:b] for a, b in ranges)])

    def part_vertices(self, *names: str) -> Indices:
        """Sorted indices of the vertices that the triangles of some parts use."""
        return np.unique(self.part_triangles(*names))

    @property
    def photographed(self) -> bool:
        """Whether its texture is a photo, with the light in it."""
        return "photo" in self.provenance

    @cached_property
    def soft_vertices(self) -> Indices:
        """Vertices that a face's motion deforms."""
        return self.part_vertices(*SOFT)

    @cached_property
    def skin_vertices(self) -> Indices:
        """Vertices of the outer skin, lids included."""
        return self.part_vertices("skin", "lids")

    def nearest_vertices(self, places: dict[str, Array]) -> dict[str, int]:
        """The skin vertex nearest to each place."""
        from scipy.spatial import cKDTree

        if not places:
            return {}
        _, found = cKDTree(self.vertices[self.skin_vertices]).query(np.array(list(places.values())))
        return {name: int(self.skin_vertices[k]) for name, k in zip(places, found, strict=True)}

    def posed(self, *, jaw_deg: float = 0.0, lids_closed: float = 0.0, units: dict[str, float] | None = None) -> Array:
        """Vertices with the jaw opened, the lids lowered and named units applied.

        Parameters
        ----------
        jaw_deg : float, degrees
            0 closed to :data:`JAW_LIMIT_DEG`.
        lids_closed : float
            0 open to 1 closed.
        units : dict of str to float, optional
            Amounts of `blendshapes`.

        Returns
        -------
        ndarray, shape (V, 3), mm

        Raises
        ------
        EvalkitError
            If this head has no such motion, or the amount is out of range.
        """
        out = self.vertices.copy()
        for name, amount in (units or {}).items():
            if name not in self.blendshapes:
                raise EvalkitError(f"{self.name}: no unit named '{name}'; it has {len(self.blendshapes)}")
            which, moves = self.blendshapes[name]
            out[which] += amount * moves
        if lids_closed:
            out = self._with_lids(out, lids_closed)
        if jaw_deg:
            out = self._with_jaw(out, jaw_deg)
        return out

    def _with_lids(self, vertices: Array, closed: float) -> Array:
        if self.lids is None:
            raise EvalkitError(f"{self.name}: its lids do not move")
        if not 0.0 <= closed <= 1.0:
            raise EvalkitError(f"lids_closed must be between 0 and 1, not {closed:g}")
        lids, out = self.lids, vertices.copy()
        which = np.flatnonzero(lids.eye >= 0)
        centre = lids.centres[lids.eye[which]]
        arm = vertices[which] - centre
        arm[:, 1:] = _turned(arm[:, 1:], closed * lids.turn[which])
        reach = np.linalg.norm(arm, axis=1)
        out[which] = centre + arm * ((reach + closed * lids.lift[which]) / reach)[:, None]
        return out

    def _with_jaw(self, vertices: Array, angle_deg: float) -> Array:
        if self.jaw is None:
            raise EvalkitError(f"{self.name}: its jaw does not move")
        if not 0.0 <= angle_deg <= JAW_LIMIT_DEG:
            raise EvalkitError(f"jaw_deg must be between 0 and {JAW_LIMIT_DEG:g}, not {angle_deg:g}")
        out = vertices.copy()
        arm = vertices[:, 1:] - self.jaw.axis[1:]
        out[:, 1:] = self.jaw.axis[1:] + _turned(arm, np.deg2rad(angle_deg) * self.jaw.weights)
        return out

    def save(self, path: str | Path) -> None:
        """Write the head to one ``.npz`` file, complete or not at all.

        Raises
        ------
        EvalkitError
            If the file cannot be written.
        """
        arrays: dict[str, Any] = {"vertices": self.vertices, "triangles": self.triangles.astype(np.int32)}
        facts: dict[str, Any] = {
            "format": FORMAT,
            "name": self.name,
            "source": self.source,
            "provenance": self.provenance,
            "parts": {name: [int(a), int(b)] for name, (a, b) in self.parts.items()},
            "landmarks": {name: [float(x) for x in place] for name, place in self.landmarks.items()},
            "marker_sites": {name: [float(x) for x in place] for name, place in self.marker_sites.items()},
            "regions": list(self.regions),
            "blendshapes": list(self.blendshapes),
        }
        for k, which in enumerate(self.regions.values()):
            arrays[f"region_{k}"] = which.astype(np.int32)
        for k, (which, moves) in enumerate(self.blendshapes.values()):
            arrays[f"unit_{k}_vertices"], arrays[f"unit_{k}_mm"] = which.astype(np.int32), moves.astype(np.float32)
        if self.jaw is not None:
            arrays["jaw_axis"], arrays["jaw_weights"] = self.jaw.axis, self.jaw.weights
        if self.lids is not None:
            facts["eye_radius"] = self.lids.radius
            arrays |= {
                "eye_centres": self.lids.centres,
                "lid_eye": self.lids.eye.astype(np.int8),
                "lid_turn": self.lids.turn,
                "lid_lift": self.lids.lift,
            }
        if self.uv is not None:
            arrays["uv"] = self.uv
        if self.texture is not None:
            arrays["texture"] = self.texture
        path = Path(path)
        temporary = path.with_name(path.name + ".part")
        try:
            with temporary.open("wb") as file:
                np.savez_compressed(file, facts=np.array(json.dumps(facts)), **arrays)
            temporary.replace(path)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise EvalkitError(f"{path}: cannot write the head ({error.strerror or error})") from error


def turned_too_far(rotations: ArrayLike, to_camera: ArrayLike = (0.0, 0.0, 1.0)) -> NDArray[np.bool_]:
    """Frames in which a head is seen too far from the side for a mask with a plate behind it.

    Parameters
    ----------
    rotations : array_like, shape (..., 3, 3)
        Head rotations; NaN counts as not turned.
    to_camera : array_like, shape (3,)
        From the head to the camera.

    Returns
    -------
    ndarray of bool, shape (...)
        True beyond :data:`VIEW_LIMIT_DEG`.
    """
    towards = np.asarray(to_camera, dtype=np.float64)
    cosine = np.asarray(rotations, dtype=np.float64)[..., :, 2] @ (towards / np.linalg.norm(towards))
    # At the limit itself rounding must not decide.
    return np.asarray(cosine < np.cos(np.deg2rad(VIEW_LIMIT_DEG)) - 1e-9)


def read_head(path: str | Path) -> Head:
    """Read what :meth:`Head.save` has written.

    Raises
    ------
    EvalkitError
        If the file is not there or is no head.
    """
    path = Path(path)
    if not path.is_file():
        raise EvalkitError(f"{path}: no such file; make a head with: evalkit head new -o DIR")
    try:
        # numpy leaves a file open that it opened itself and then could not read.
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            facts = json.loads(str(file["facts"]))
            arrays = {name: file[name] for name in file.files if name != "facts"}
        if facts["format"] != FORMAT:
            raise EvalkitError(f"{path}: head format {facts['format']} is not known here ({FORMAT} is)")
        return _assemble(facts, arrays)
    except EvalkitError:
        raise
    except Exception as error:
        # A zip that is cut short or something else altogether: numpy raises a dozen different errors.
        raise EvalkitError(f"{path}: not a head file ({type(error).__name__}: {error})".splitlines()[0]) from error


def _assemble(facts: dict[str, Any], arrays: dict[str, Any]) -> Head:
    jaw = Jaw(arrays["jaw_axis"], arrays["jaw_weights"]) if "jaw_axis" in arrays else None
    lids = None
    if "eye_centres" in arrays:
        eye = arrays["lid_eye"].astype(np.intp)
        lids = Lids(arrays["eye_centres"], facts["eye_radius"], eye, arrays["lid_turn"], arrays["lid_lift"])
    return Head(
        name=facts["name"],
        vertices=np.asarray(arrays["vertices"], dtype=np.float64),
        triangles=arrays["triangles"].astype(np.intp),
        parts={name: (int(a), int(b)) for name, (a, b) in facts["parts"].items()},
        regions={name: arrays[f"region_{k}"].astype(np.intp) for k, name in enumerate(facts["regions"])},
        landmarks={name: np.array(place) for name, place in facts["landmarks"].items()},
        marker_sites={name: np.array(place) for name, place in facts["marker_sites"].items()},
        jaw=jaw,
        lids=lids,
        uv=arrays.get("uv"),
        texture=arrays.get("texture"),
        blendshapes={
            name: (arrays[f"unit_{k}_vertices"].astype(np.intp), arrays[f"unit_{k}_mm"].astype(np.float64))
            for k, name in enumerate(facts["blendshapes"])
        },
        source=facts["source"],
        provenance=facts.get("provenance", {}),
    )


def _turned(yz: Array, angle: Array) -> Array:
    """Rotation about x by an angle that lowers what lies in front; (N, 2) by (N,)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([cos * yz[:, 0] - sin * yz[:, 1], sin * yz[:, 0] + cos * yz[:, 1]], axis=1)
