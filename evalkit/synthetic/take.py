"""From parameters and a seed to a take: the observed capture and its truth."""

from __future__ import annotations

import hashlib
import json
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evalkit.capture.model import Capture
from evalkit.errors import EvalkitError
from evalkit.seeds import seed_sequence
from evalkit.synthetic.expression import express
from evalkit.synthetic.faults import displace, faulty_samples, label_swaps, quantise
from evalkit.synthetic.motion import head_angles, rotations_from_angles
from evalkit.synthetic.neck import neck_sway, second_joint
from evalkit.synthetic.noise import BLOCK, add_noise
from evalkit.synthetic.parameters import Parameters
from evalkit.synthetic.performer import STANDING_AT, Performer, make_performer
from evalkit.synthetic.presets import preset_parameters
from evalkit.synthetic.truth import Truth


def synthesize(preset: str | Parameters = "talking", seed: int = 0, **overrides: Any) -> tuple[Capture, Truth]:
    """A synthetic capture with its truth.

    Every part of the take (each axis of the motion, sway, each expression, noise, each fault) draws from a stream
    of its own: changing one of them leaves the others as they were. The same arguments give the same bits.

    Parameters
    ----------
    preset : str or Parameters
        Name in `PRESETS`, or the parameters themselves.
    seed : int
        Seed.
    **overrides
        Fields of `Parameters` to change, such as ``noise=0.5`` or ``frames=6000``.

    Returns
    -------
    capture : Capture
        What was observed, mm, NaN in gaps. World axes: x to the performer's left, y up, z forward; the
        origin is on the floor.
    truth : Truth
        What made it.

    Raises
    ------
    EvalkitError
        If the preset, an override or the seed is not known or does not fit; the text names the nearest one.

    Examples
    --------
    The truth explains the take but for the noise that was asked for:

    >>> import numpy as np
    >>> import evalkit
    >>> take, truth = evalkit.synthesize("talking", seed=0, noise=0.3)
    >>> take.points.shape, truth.rigid
    ((600, 23, 3), ('ForeheadC', 'ForeheadL', 'ForeheadR'))
    >>> truth.pivot
    array([ 140., 1460.,  260.])
    >>> face = truth.neutral + truth.expression
    >>> exact = np.einsum("fij,fmj->fmi", truth.rotations, face) + truth.translations[:, None]
    >>> round(float(np.std(take.points - exact)), 2)
    0.3
    """
    if isinstance(preset, Parameters):
        name, parameters = "custom", preset.replaced(overrides)
    else:
        name, parameters = preset, preset_parameters(preset, overrides)
    seed_sequence(seed=seed)  # refuses what is not a seed, even if no part of this take draws
    seed = int(seed)

    performer = make_performer(parameters.layout, parameters.performer)
    times = np.arange(parameters.frames) / parameters.rate
    angles = head_angles(times, parameters.range_deg, parameters.speed, seed, parameters.profile)
    rotations = rotations_from_angles(angles)
    sway = neck_sway(times, parameters.sway, parameters.sway_hz, seed)
    if parameters.neck_gap_mm:
        sway += second_joint(angles, parameters.neck_gap_mm)
    expression = express(
        performer,
        times,
        parameters.actions,
        amplitude=parameters.expression,
        liveliness=parameters.liveliness,
        skin=parameters.skin,
        seed=seed,
        asymmetry=parameters.asymmetry,
    )
    neutral = performer.sites + STANDING_AT
    pivot = performer.pivot + STANDING_AT
    translations = pivot - rotations @ pivot + sway

    points = expression + (neutral - pivot)
    for start in range(0, len(points), BLOCK):
        frames = slice(start, start + BLOCK)
        points[frames] = points[frames] @ rotations[frames].transpose(0, 2, 1)
    points += (pivot + sway)[:, None, :]
    observed, identity, outliers, missing = _observe(points, performer, parameters, seed)

    # The operator faces the performer: the performer's left is the screen's right.
    capture = Capture(observed, performer.labels, parameters.rate, axes=("+X", "+Y"))
    truth = Truth(
        rotations=rotations,
        translations=translations,
        pivot=pivot,
        sway=sway,
        neutral=neutral,
        expression=expression,
        visible=~missing,
        outliers=outliers,
        identity=identity,
        nod_centre=pivot + np.array([0.0, parameters.neck_gap_mm, 0.0]),
        noise_mm=parameters.noise,
        labels=performer.labels,
        rigid=performer.rigid,
        rate=parameters.rate,
        preset=name,
        seed=seed,
        parameters=parameters.as_dict(),
    )
    return capture, truth


def _observe(
    points: NDArray[np.float64], performer: Performer, parameters: Parameters, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
    """What a capture system makes of the true positions (F, M, 3): observed positions, NaN where missing, and

    by label, each (F, M), which marker is seen, which samples are outliers and which are missing.
    """
    frames, markers = points.shape[:2]
    identity = label_swaps(frames, performer.sites, parameters.swaps, parameters.swap_length, seed)
    if parameters.swaps:
        points = np.take_along_axis(points, identity[..., None], axis=1)
    add_noise(
        points,
        parameters.noise,
        seed,
        steps=parameters.noise_time_s * parameters.rate,
        shared=parameters.noise_shared,
        sites=performer.sites,
    )
    gaps = (parameters.gaps, parameters.gap_bursts, parameters.gap_length)
    missing = faulty_samples("gaps", frames, markers, *gaps, seed)
    spoils = (parameters.outliers, parameters.outlier_bursts, parameters.outlier_length)
    outliers = faulty_samples("outliers", frames, markers, *spoils, seed)
    displace(points, outliers, parameters.outlier_mm, seed)
    points[missing] = np.nan
    if parameters.quantum_mm:
        quantise(points, parameters.quantum_mm)
    # A sample that was not seen was not seen wrongly either.
    return points, np.where(missing, np.arange(markers), identity), outliers & ~missing, missing


class SyntheticFiles(NamedTuple):
    """The three files of one synthetic take."""

    capture: Path
    truth: Path
    manifest: Path


def write_synthetic(preset: str, directory: str | Path, seed: int = 0, **overrides: Any) -> SyntheticFiles:
    """Write a synthetic take: ``<preset>.c3d``, ``<preset>.truth.npz`` and ``<preset>.json``.

    The JSON holds the parameters, the seed, the version of evalkit, the units and the SHA-256 of the other
    two. C3D stores 32-bit numbers; the truth is exact before that rounding. Coordinates on a grid (``quantum_mm``)
    are written in reals too, with the values that a file of integers would give. The files are made in a
    temporary directory beside their place and then renamed, so none is ever seen half written.

    Parameters
    ----------
    preset : str
        Name in `PRESETS`.
    directory : str or Path
        Where to write; made if it does not exist. Files of these names are replaced.
    seed : int
        Seed.
    **overrides
        Fields of `Parameters` to change.

    Returns
    -------
    SyntheticFiles
        Paths of capture, truth and manifest.

    Raises
    ------
    EvalkitError
        As `synthesize`, or if the directory cannot be written.
    """
    from evalkit.capture import write_capture

    capture, truth = synthesize(preset, seed, **overrides)
    directory = Path(directory)
    files = SyntheticFiles(*(directory / (truth.preset + end) for end in (".c3d", ".truth.npz", ".json")))
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".synthetic-", dir=directory) as working:
            made = SyntheticFiles(*(Path(working) / path.name for path in files))
            write_capture(capture, made.capture)
            truth.save(made.truth)
            manifest = json.dumps(_manifest(truth, made), indent=2) + "\n"
            made.manifest.write_text(manifest, encoding="utf-8")
            for temporary, path in zip(made, files, strict=True):
                temporary.replace(path)
    except OSError as error:
        raise EvalkitError(f"{directory}: cannot write there ({error.strerror})") from error
    return files


def _manifest(truth: Truth, files: SyntheticFiles) -> dict[str, Any]:
    """What is written about a take beside it."""
    import evalkit

    return {
        "preset": truth.preset,
        "seed": truth.seed,
        "parameters": truth.parameters,
        "evalkit_version": getattr(evalkit, "__version__", "unknown"),
        "units": {"length": "mm", "angle": "deg", "time": "s", "rate": "Hz"},
        "axes": {"x": "performer's left", "y": "up", "z": "forward"},
        "frames": len(truth.visible),
        "labels": list(truth.labels),
        "rigid": list(truth.rigid),
        "pivot_mm": truth.pivot.tolist(),
        "sha256": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files[:2]},
    }
