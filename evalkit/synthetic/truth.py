"""The truth behind a synthetic take."""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.errors import EvalkitError

FORMAT = 2
"""Version of the truth file. Format 1 had no `ADDED`; it is read as a take without these faults."""

UNREADABLE = (
    ValueError,
    KeyError,
    EOFError,
    zlib.error,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
)
"""What zipfile, zlib, json and NumPy raise on damaged bytes, besides BadZipFile and OSError."""

ARRAYS: dict[str, tuple[tuple[str, ...], type]] = {
    "rotations": (("F", "", ""), np.float64),
    "translations": (("F", ""), np.float64),
    "pivot": (("",), np.float64),
    "sway": (("F", ""), np.float64),
    "neutral": (("M", ""), np.float64),
    "expression": (("F", "M", ""), np.float64),
    "visible": (("F", "M"), np.bool_),
    "outliers": (("F", "M"), np.bool_),
    "identity": (("F", "M"), np.int64),
    "nod_centre": (("",), np.float64),
}
"""Array -> its axes (F frames, M markers, otherwise 3) and type."""

ADDED = ("outliers", "identity", "nod_centre")
"""Arrays that came with format 2."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Everything that made a synthetic take, exactly.

    An observed position is ``x[i, m] = R[i] (P[k] + E[i, k] - O) + O + s[i] + noise``, k = m unless labels were
    exchanged, and with a displacement on top in outliers. With ``T[i] = (I - R[i]) O + s[i]`` that is
    ``x = R p + T`` for a point p of the head frame. The head frame is that of the neutral pose: its axes and
    origin are the world's when R = I and s = 0. A capture file stores 32-bit numbers; the truth is exact before
    that rounding (below 0.0001 mm within 2 m of the origin).

    Rotations, translations, pivot, sway, neutral face and expression are by marker, and always true. The masks are
    by label, as is the capture.

    Parameters
    ----------
    rotations : ndarray, shape (F, 3, 3)
        R, head frame to world.
    translations : ndarray, shape (F, 3)
        T, mm.
    pivot : ndarray, shape (3,)
        O, the centre of rotation in the neutral pose, mm; in a neck of two joints that of turn and tilt.
    sway : ndarray, shape (F, 3)
        s, translation of the pivot, mm, zero mean over the frames; exactly 0 for a fixed pivot. In a neck of two
        joints it contains what the second joint adds, `evalkit.synthetic.neck`, whose mean is not zero.
    neutral : ndarray, shape (M, 3)
        P, the face at rest in the head frame, mm.
    expression : ndarray, shape (F, M, 3)
        E, displacement by the face's own motion in the head frame, mm. Zero on the rigid markers, unless
        the skin under them slides (parameter ``skin`` above 0): the slide is in E.
    visible : ndarray of bool, shape (F, M)
        False where the capture has a gap.
    outliers : ndarray of bool, shape (F, M)
        True where the capture has a position that was displaced.
    identity : ndarray of int, shape (F, M)
        k, the marker that is seen under each label; m itself unless labels were exchanged.
    nod_centre : ndarray, shape (3,)
        N, where the nod has its centre in the neutral pose, mm: the pivot, unless the neck has two joints.
    noise_mm : float
        Standard deviation of the noise per axis, mm.
    labels : tuple of str, length M
        Marker names.
    rigid : tuple of str
        Labels of the markers taken as rigid with the skull.
    rate : float
        Frames per second, Hz.
    preset : str
        Name of the preset, or "custom".
    seed : int
        Seed.
    parameters : dict
        All parameters of the take.
    """

    rotations: NDArray[np.float64]
    translations: NDArray[np.float64]
    pivot: NDArray[np.float64]
    sway: NDArray[np.float64]
    neutral: NDArray[np.float64]
    expression: NDArray[np.float64]
    visible: NDArray[np.bool_]
    outliers: NDArray[np.bool_]
    identity: NDArray[np.int64]
    nod_centre: NDArray[np.float64]
    noise_mm: float
    labels: tuple[str, ...]
    rigid: tuple[str, ...]
    rate: float
    preset: str
    seed: int
    parameters: dict[str, Any]

    @property
    def clean(self) -> NDArray[np.float64]:
        """P + E: the face with its expressions and without head motion, head frame, mm, shape (F, M, 3)."""
        return self.neutral + self.expression

    @property
    def swapped(self) -> NDArray[np.bool_]:
        """True where a label carries another marker than its own, shape (F, M)."""
        return np.asarray(self.identity != np.arange(len(self.labels)))

    @property
    def rigid_slide_mm(self) -> float:
        """Largest slide of a rigid marker over the skull in this take, mm; 0 where they are truly rigid."""
        slide = self.expression[:, np.isin(self.labels, self.rigid)]
        return float(np.sqrt((slide**2).sum(axis=2)).max(initial=0.0))

    def save(self, path: str | Path) -> None:
        """Write the truth as a NumPy archive (.npz) without pickled objects.

        Parameters
        ----------
        path : str or Path
            File to write; replaced if it exists.

        Raises
        ------
        EvalkitError
            If the file cannot be written.
        """
        values = {name: getattr(self, name) for name in ARRAYS}
        rest = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name not in ARRAYS}
        try:
            with Path(path).open("wb") as file:
                np.savez_compressed(file, facts=json.dumps({"format": FORMAT, **rest}, sort_keys=True), **values)
        except OSError as error:
            raise EvalkitError(f"{path}: cannot write the truth ({error.strerror})") from error

    @classmethod
    def load(cls, path: str | Path) -> Truth:
        """Read what `save` wrote.

        Raises
        ------
        EvalkitError
            If the file cannot be read, is not a truth file, or its parts do not fit together.
        """
        try:
            # Member by member and not by np.load: zipfile checks each one's checksum, so that NumPy never
            # interprets a damaged header.
            with zipfile.ZipFile(path) as archive:
                names = [name.removesuffix(".npy") for name in archive.namelist()]
                missing = [name for name in ("facts", *ARRAYS) if name not in (*names, *ADDED)]
                if missing:
                    raise EvalkitError(f"{path}: not a truth file; it lacks {', '.join(missing)}")
                parts = {
                    name: np.lib.format.read_array(io.BytesIO(archive.read(f"{name}.npy")), allow_pickle=False)
                    for name in ("facts", *ARRAYS)
                    if name in names
                }
            facts = json.loads(str(parts.pop("facts")))
        except zipfile.BadZipFile as error:
            raise EvalkitError(f"{path}: not a truth file, or a damaged one ({error})") from error
        except OSError as error:
            raise EvalkitError(f"{path}: cannot read the truth ({error.strerror or error})") from error
        except UNREADABLE as error:
            reason = " ".join(str(error).split())[:120]
            raise EvalkitError(f"{path}: the truth file is damaged ({reason})") from error
        return cls._checked(path, facts, parts)

    @classmethod
    def _checked(cls, path: str | Path, facts: Any, arrays: dict[str, NDArray[Any]]) -> Truth:
        """The truth from the parts of a file, if they fit together."""
        expected: dict[str, type | tuple[type, ...]] = {
            "format": int,
            "noise_mm": (int, float),
            "labels": list,
            "rigid": list,
            "rate": (int, float),
            "preset": str,
            "seed": int,
            "parameters": dict,
        }
        if not isinstance(facts, dict):
            raise EvalkitError(f"{path}: the truth's facts are not a table")
        for name, types in expected.items():
            if not isinstance(facts.get(name), types):
                raise EvalkitError(f"{path}: the truth has no valid '{name}'")
        if facts["format"] not in (1, FORMAT):
            raise EvalkitError(f"{path}: truth of format {facts['format']}; this version reads formats 1 and {FORMAT}")
        sizes = {"F": len(arrays["visible"]) if arrays["visible"].ndim else 0, "M": len(facts["labels"])}
        if facts["format"] == 1:
            as_labelled = np.tile(np.arange(sizes["M"]), (sizes["F"], 1))
            sound = np.zeros(as_labelled.shape, dtype=bool)
            arrays = {**arrays, "outliers": sound, "identity": as_labelled, "nod_centre": arrays["pivot"]}
        lacking = [name for name in ADDED if name not in arrays]
        if lacking:
            raise EvalkitError(f"{path}: the truth lacks {', '.join(lacking)}")
        for name, (axes, kind) in ARRAYS.items():
            shape = tuple(sizes.get(axis, 3) for axis in axes)
            if arrays[name].shape != shape:
                raise EvalkitError(f"{path}: {name} has shape {arrays[name].shape}; expected {shape}")
            if arrays[name].dtype != kind:
                raise EvalkitError(f"{path}: {name} is of type {arrays[name].dtype}")
            if not np.isfinite(arrays[name]).all():
                raise EvalkitError(f"{path}: {name} has values that are not finite")
        if not ((arrays["identity"] >= 0) & (arrays["identity"] < sizes["M"])).all():
            raise EvalkitError(f"{path}: identity names markers that are not there")
        labels, rigid = tuple(map(str, facts["labels"])), tuple(map(str, facts["rigid"]))
        stranger = next((label for label in rigid if label not in labels), None)
        if stranger is not None:
            raise EvalkitError(f"{path}: rigid marker '{stranger}' is not among the labels")
        rotations, pivot = arrays["rotations"], arrays["pivot"]
        if np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(initial=0) > 1e-9:
            raise EvalkitError(f"{path}: rotations are not orthogonal")
        if np.abs(arrays["translations"] - (pivot - rotations @ pivot + arrays["sway"])).max(initial=0) > 1e-6:
            raise EvalkitError(f"{path}: translations are not (I - R) O + s")
        return cls(
            **arrays,
            noise_mm=float(facts["noise_mm"]),
            labels=labels,
            rigid=rigid,
            rate=float(facts["rate"]),
            preset=facts["preset"],
            seed=facts["seed"],
            parameters=facts["parameters"],
        )
