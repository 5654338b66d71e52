"""The reference set: a few small takes, one for each kind of fault, with a manifest by which they are made again."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evalkit.capture import read_capture
from evalkit.errors import EvalkitError
from evalkit.synthetic.parameters import Parameters
from evalkit.synthetic.presets import PRESETS
from evalkit.synthetic.take import write_synthetic
from evalkit.synthetic.truth import ARRAYS, Truth

MANIFEST = "MANIFEST.json"
BESIDE = (MANIFEST, "README.md")
"""Files of the folder that the manifest does not list."""

FRAMES = {
    120: ("dense", "outliers", "label-swaps"),
    240: (
        "clean", "reduced", "small-motion", "held", "shaking", "reading", "sway", "two-joints", "skin", "one-sided",
        "coloured-noise", "quantised", "worst-day",
    ),
    600: ("talking", "gaps", "single-axis"),
}  # fmt: skip
"""Frames of a take -> presets: as few as still show the subject, so that the set stays small."""

SEED = 0
"""Seed of every take."""

CAPTURE_TOLERANCE_MM = 1.3e-4
"""One step of a 32-bit number between 1 and 2 m is 0.00012 mm. Another machine's sines differ in the last of 53
bits, which can move a coordinate across one rounding of the file."""

TRUTH_TOLERANCE = 1e-9
"""The same differences before rounding, with the lever of 2 m and some hundred operations, mm (or parts of 1)."""


class Verdict(NamedTuple):
    """What became of one file.

    Parameters
    ----------
    file : str
        Name.
    same : bool
        Whether it is what the generator makes.
    text : str
        In words.
    """

    file: str
    same: bool
    text: str


def write_reference(directory: str | Path) -> list[Path]:
    """Write the reference set: captures, truths and the manifest.

    Parameters
    ----------
    directory : str or Path
        Made if it does not exist. Files of these names are replaced, once the whole set is made.

    Returns
    -------
    list of Path
        The files written, the manifest last.

    Raises
    ------
    EvalkitError
        If the directory cannot be written.
    """
    directory = Path(directory)
    written = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".reference-", dir=directory) as working:
            takes = [_write_take(preset, frames, Path(working)) for frames, some in FRAMES.items() for preset in some]
            manifest = {"units": {"length": "mm", "angle": "deg", "time": "s"}, "takes": takes}
            (Path(working) / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
            for name in (*(name for take in takes for name in take["sha256"]), MANIFEST):
                (Path(working) / name).replace(directory / name)
                written.append(directory / name)
    except OSError as error:
        raise EvalkitError(f"{directory}: cannot write there ({error.strerror})") from error
    return written


def _write_take(preset: str, frames: int, directory: Path) -> dict[str, Any]:
    """Write one take; return its entry of the manifest."""
    files = write_synthetic(preset, directory, seed=SEED, frames=frames)
    about = json.loads(files.manifest.read_text(encoding="utf-8"))
    files.manifest.unlink()
    return {
        "preset": preset,
        "about": PRESETS[preset].text,
        "seed": SEED,
        "parameters": about["parameters"],
        "evalkit_version": about["evalkit_version"],
        "command": f"evalkit synth {preset} -o DIR --seed {SEED} --set frames={frames}",
        "sha256": about["sha256"],
    }


def check_reference(directory: str | Path) -> Iterator[Verdict]:
    """Make every take of a folder's manifest again and compare.

    A file passes if it has the checksum of the manifest, and is what the generator makes: bit by bit, or within
    `CAPTURE_TOLERANCE_MM` and `TRUTH_TOLERANCE` where another machine made it.

    Parameters
    ----------
    directory : str or Path
        Folder with a MANIFEST.json.

    Yields
    ------
    Verdict
        One for each file of the manifest, and one for each other file in the folder.

    Raises
    ------
    EvalkitError
        If the manifest cannot be read.
    """
    directory = Path(directory)
    takes = _read_manifest(directory / MANIFEST)
    for take in takes:
        with tempfile.TemporaryDirectory(prefix="evalkit-reference-") as working:
            try:
                parameters = Parameters().replaced(take["parameters"]).as_dict()
                write_synthetic(take["preset"], working, seed=take["seed"], **parameters)
            except EvalkitError as error:
                yield from (Verdict(name, False, f"DIFFERS: cannot be made again: {error}") for name in take["sha256"])
                continue
            for name, checksum in take["sha256"].items():
                yield _compare(directory / name, Path(working) / name, checksum)
    known = {*BESIDE, *(name for take in takes for name in take["sha256"])}
    for path in sorted(directory.iterdir()):
        if path.name not in known:
            yield Verdict(path.name, False, f"DIFFERS: not in {MANIFEST}")


def _read_manifest(path: Path) -> list[dict[str, Any]]:
    try:
        takes = json.loads(path.read_text(encoding="utf-8"))["takes"]
    except OSError as error:
        raise EvalkitError(f"{path}: cannot read the manifest ({error.strerror})") from error
    except (ValueError, KeyError, TypeError) as error:
        raise EvalkitError(f"{path}: not a manifest of takes; write a set with: evalkit synth --reference") from error
    kinds = {"preset": str, "seed": int, "parameters": dict, "sha256": dict}
    for number, take in enumerate(takes if isinstance(takes, list) else [None], start=1):
        for key, kind in kinds.items():
            if not isinstance(take, dict) or not isinstance(take.get(key), kind):
                raise EvalkitError(f"{path}: take {number} has no valid '{key}'")
    return list(takes)


def _compare(path: Path, made: Path, checksum: str) -> Verdict:
    """Verdict on a file beside the same one made again."""
    if not path.is_file():
        return Verdict(path.name, False, "DIFFERS: missing")
    if not made.is_file():
        return Verdict(path.name, False, "DIFFERS: the generator makes no such file")
    stored = path.read_bytes()
    if stored == made.read_bytes():
        largest = 0.0
    else:
        try:
            truth = path.suffix == ".npz"
            largest = _truth_difference(path, made) if truth else _capture_difference(path, made)
        except EvalkitError as error:
            return Verdict(path.name, False, f"DIFFERS: {error}")
        if not largest <= (TRUTH_TOLERANCE if truth else CAPTURE_TOLERANCE_MM):
            return Verdict(path.name, False, f"DIFFERS: by up to {largest:.3g} mm")
    if hashlib.sha256(stored).hexdigest() != checksum:
        return Verdict(path.name, False, f"DIFFERS: its SHA-256 is not that of {MANIFEST}")
    return Verdict(path.name, True, f"equal within {largest:.2g} mm" if largest else "identical")


def _largest(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    return float(np.nanmax(np.abs(one - other), initial=0.0))


def _capture_difference(path: Path, made: Path) -> float:
    """Largest difference of two captures, mm."""
    one, other = read_capture(path), read_capture(made)
    for name in ("labels", "rate", "unit", "axes", "first_frame", "frames"):
        if getattr(one, name) != getattr(other, name):
            raise EvalkitError(f"{name}: {getattr(one, name)}; expected {getattr(other, name)}")
    if not np.array_equal(one.visible, other.visible):
        raise EvalkitError("other samples are missing than should be")
    return _largest(one.points, other.points)


def _truth_difference(path: Path, made: Path) -> float:
    """Largest difference of the numbers of two truths."""
    one, other = Truth.load(path), Truth.load(made)
    for name in ("labels", "rigid", "rate", "preset", "seed", "noise_mm", "parameters"):
        if getattr(one, name) != getattr(other, name):
            raise EvalkitError(f"{name}: not that of the take")
    largest = 0.0
    for name, (_, kind) in ARRAYS.items():
        mine, its = getattr(one, name), getattr(other, name)
        if mine.shape != its.shape or (kind is not np.float64 and not np.array_equal(mine, its)):
            raise EvalkitError(f"{name}: not that of the take")
        if kind is np.float64:
            largest = max(largest, _largest(mine, its))
    return largest
