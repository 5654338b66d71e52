"""Filmed heads: videos of textured, acting heads whose pose and shape are known in every frame.

A head of :mod:`evalkit.studies.filmed_heads` moves and acts before the camera of
:mod:`evalkit.render.camera_scene`; :mod:`evalkit.studies.picture_faults` does to the pictures what sensors, rooms and
encoders do. Everything random follows from the seed.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit import __version__
from evalkit.dense import Performance, perform
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, apply_motion
from evalkit.head.model import Indices
from evalkit.render.camera_scene import LIGHTS, CameraScene
from evalkit.results import staged, write_json
from evalkit.seeds import generator
from evalkit.studies.filmed_heads import HEADS, PROJECTED, filmed_face, point_sources
from evalkit.studies.picture_faults import (
    OCCLUDERS,
    Image,
    clutter,
    compressed,
    covered,
    gains,
    occluder_sprite,
    sensed,
    write_h264,
)
from evalkit.synthetic.expression import ACTION_NAMES
from evalkit.synthetic.motion import head_angles, hum, minimum_jerk, rotations_from_angles
from evalkit.synthetic.parameters import setting, unknown
from evalkit.synthetic.performer import PIVOT
from evalkit.vision.camera import Camera
from evalkit.vision.points import FACE_POINTS

START_DEG = (4.0, 5.0, 3.0)
"""Standard deviation of nod, turn and tilt in the first frame: nobody starts exactly straight."""

SETTLED_S = 0.3
"""Time in which motion and expression begin; the first frame is neutral."""

DRIFT_HZ = (0.1, 0.5)
"""Band in which the head sways to and fro."""

FACE_MM = 150.0
"""Width of a face."""

MIDDLE = np.array([0.0, 10.0, 60.0])
"""About the middle of a head's face, mm."""

FACING = 0.1
"""Cosine between skin and view below which a point is taken to be hidden by the head itself."""

LIMITS: dict[str, tuple[float, float]] = {
    "frames": (2, 20_000), "rate_hz": (1, 1000), "width": (64, 1920), "height": (64, 1080), "view_deg": (10, 100),
    "distance_mm": (250, 3000), "speed": (1, 1000), "drift_mm": (0, 200), "expression": (0, 1.5),
    "liveliness": (0.1, 10), "flicker": (0, 1), "noise": (0, 50), "shutter": (0, 1), "crf": (0, 51),
    "away": (0, 0.9), "click_px": (0, 20),
}  # fmt: skip
"""Parameter -> smallest and largest value."""

SUBFRAMES = 5
"""Pictures that are averaged in a frame with motion blur: steps of less than a pixel up to 5 px of blur."""


@dataclass(frozen=True)
class VideoParameters:
    """Everything that a filmed head depends on, besides the seed.

    Attributes
    ----------
    head : str
        Key of :data:`evalkit.studies.filmed_heads.HEADS`.
    frames : int
    rate_hz : float
    width, height : int, pixels
        Even, as the encoder wants it.
    view_deg : float
        Field of view of the longer side.
    distance_mm : float
        Of the head from the camera.
    range_deg : (float, float, float)
        Largest nod, turn and tilt.
    speed : float, deg/s
        Fastest change of posture about one axis.
    drift_mm : float
        Sway along each axis, standard deviation.
    actions : tuple of str
        Out of :data:`evalkit.synthetic.expression.ACTION_NAMES`.
    expression, liveliness : float
        How strong and how often; 0 for a face that stays as it is.
    light : str
        Key of :data:`evalkit.render.camera_scene.LIGHTS`.
    flicker : float
        Standard deviation of the logarithm of the brightness over time, about.
    noise : float
        Of the sensor, grey levels in the dark.
    shutter : float
        Share of a frame's time that it is exposed: motion blur.
    crf : int
        Constant rate factor of H.264: 18 fine, 28 coarse, 0 no encoder.
    occluder : str
        What passes before the face in the middle of the video: none, hand or bar.
    away : float
        Share of the frames in which the face has left the picture, or is on its way out and back; 0 for none.
    click_px : float
        Standard deviation of the error with which the 19 points are placed in the first frame.

    Raises
    ------
    EvalkitError
        If a value is of the wrong type or out of range.
    """

    head: str = "template"
    frames: int = 90
    rate_hz: float = 30.0
    width: int = 360
    height: int = 288
    view_deg: float = 45.0
    distance_mm: float = 600.0
    range_deg: tuple[float, float, float] = (10.0, 20.0, 8.0)
    speed: float = 60.0
    drift_mm: float = 8.0
    actions: tuple[str, ...] = ACTION_NAMES
    expression: float = 0.8
    liveliness: float = 2.0
    light: str = "camera"
    flicker: float = 0.0
    noise: float = 2.0
    shutter: float = 0.0
    crf: int = 23
    occluder: str = "none"
    away: float = 0.0
    click_px: float = 1.0

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
                raise EvalkitError(f"{name} = {value!r} is not a number from {low:g} to {high:g}")
        for name in ("frames", "width", "height", "crf"):
            if not isinstance(getattr(self, name), int):
                raise EvalkitError(f"{name} = {getattr(self, name)!r} is not a whole number")
        if self.width % 2 or self.height % 2:
            raise EvalkitError(f"{self.width} x {self.height} pixels: the encoder needs even numbers")
        named: dict[str, tuple[str, ...]] = {"head": (*HEADS,), "light": (*LIGHTS,), "occluder": OCCLUDERS}
        for name, known in named.items():
            if getattr(self, name) not in known:
                raise EvalkitError(f"{name} {getattr(self, name)!r} is not one of {', '.join(known)}")
        if len(self.range_deg) != 3 or not all(0.0 <= angle <= 90.0 for angle in self.range_deg):
            raise EvalkitError(f"range_deg = {self.range_deg}: give nod, turn and tilt, 0 to 90 degrees each")
        for action in self.actions:
            if action not in ACTION_NAMES:
                raise EvalkitError(unknown("action", action, ACTION_NAMES))

    def replaced(self, overrides: Mapping[str, Any]) -> VideoParameters:
        """The same parameters with some of them changed by name.

        Raises
        ------
        EvalkitError
            If a name is not a parameter or a value does not fit.
        """
        names = [field.name for field in dataclasses.fields(self)]
        for name in overrides:
            if name not in names:
                raise EvalkitError(unknown("parameter", name, names))
        return dataclasses.replace(self, **overrides)

    def settings(self) -> str:
        """What differs from the defaults, as ``--set`` reads it."""
        default = VideoParameters()
        return " ".join(
            f"{field.name}={setting(getattr(self, field.name))}"
            for field in dataclasses.fields(self)
            if getattr(self, field.name) != getattr(default, field.name)
        )

    @property
    def camera(self) -> Camera:
        """The camera."""
        known = Camera.assumed_for(self.width, self.height, self.view_deg)
        return dataclasses.replace(known, assumed=False)


def parse_video_overrides(settings: Iterable[str]) -> dict[str, Any]:
    """Overrides from ``name=value`` texts, as on a command line; lists are separated by commas.

    Raises
    ------
    EvalkitError
        If a text has no ``=``, the name is not a parameter, or the value does not read as its type.
    """
    defaults: dict[str, Any] = dataclasses.asdict(VideoParameters())
    found: dict[str, Any] = {}
    for text in settings:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            raise EvalkitError(f"setting {text!r} is not of the form name=value")
        if name not in defaults:
            raise EvalkitError(unknown("parameter", name, list(defaults)))
        parts = [part.strip() for part in value.split(",") if part.strip()]
        default = defaults[name]
        try:
            if name == "range_deg":
                found[name] = tuple(float(part) for part in parts)
            elif isinstance(default, tuple):
                found[name] = tuple(parts)
            else:
                found[name] = type(default)(value)
        except ValueError:
            kind = "a whole number" if isinstance(default, int) else "a number"
            raise EvalkitError(f"{name} = {value!r} does not read as {kind}") from None
    return found


@dataclass(frozen=True)
class VideoPreset:
    """Parameters with a name's worth of meaning: one line, and what differs from the defaults."""

    text: str
    parameters: VideoParameters


VIDEO_PRESETS: dict[str, VideoPreset] = {
    "video-talking": VideoPreset(
        "a face that talks and turns before a webcam: ±20°, headlight, noise, H.264", VideoParameters()
    ),
    "video-clean": VideoPreset(
        "the same without expression, shading, noise or encoder",
        VideoParameters(expression=0.0, light="even", noise=0.0, crf=0),
    ),
    "video-turning": VideoPreset(
        "a head that only turns: no parameter of the face may change",
        VideoParameters(expression=0.0, range_deg=(0.0, 30.0, 0.0)),
    ),
    "video-jaw": VideoPreset(
        "a head that stays while its mouth opens: what passes for a nod",
        VideoParameters(range_deg=(0.0, 0.0, 0.0), drift_mm=0.0, actions=("jaw_open",), expression=1.0),
    ),
    "video-lamp": VideoPreset(
        "a lamp in the room, to one side, whose light drifts and flickers",
        VideoParameters(light="lamp", flicker=0.15),
    ),
    "video-blurred": VideoPreset(
        "fast turns with motion blur, strong noise, coarse H.264",
        VideoParameters(speed=150.0, shutter=0.6, noise=5.0, crf=30),
    ),
    "video-occluded": VideoPreset(
        "a hand passes before a face that opens its mouth",
        VideoParameters(occluder="hand", actions=("jaw_open", "speech", "blink"), frames=120),
    ),
    "video-leaving": VideoPreset(
        "the face leaves the picture and comes back", VideoParameters(away=0.4, frames=120)
    ),
}  # fmt: skip
"""The presets; all begin with ``video-``, so that none is taken for a capture."""


@dataclass(frozen=True, eq=False)
class VideoTruth:
    """What is known of a filmed head.

    Attributes
    ----------
    rotations : ndarray, shape (F, 3, 3)
    translations : ndarray, shape (F, 3), mm
        ``x = R P + T`` from the head's axes to the camera's of :mod:`evalkit.vision.camera`.
    face_mm : ndarray, shape (F, 19, 3)
        The points of :data:`evalkit.vision.points.FACE_POINTS` in the head's axes: x and y are the frontal view.
    points_px : ndarray, shape (F, 19, 2)
        The same in the picture.
    neutral_mm : ndarray, shape (19, 3)
        The same of the head at rest.
    visible : ndarray of bool, shape (F, 19)
        Points within the picture on skin that faces the camera, with nothing before them.
    present : ndarray of bool, shape (F,)
        Frames in which the middle of the face is in the picture.
    covered : ndarray, shape (F,)
        Share of the points within the picture that something hides.
    rate_hz : float
    clicked_px : ndarray, shape (19, 2)
        The points of the first frame as a user places them, with his error.
    camera : Camera
    """

    rotations: Array
    translations: Array
    face_mm: Array
    points_px: Array
    neutral_mm: Array
    visible: NDArray[np.bool_]
    present: NDArray[np.bool_]
    covered: Array
    rate_hz: float
    clicked_px: Array
    camera: Camera

    def arrays(self) -> dict[str, Any]:
        """Everything as arrays by name, for a file."""
        found = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "camera"}
        focal = (self.camera.focal_px, *self.camera.centre_px)
        return {**found, "camera_px": np.array([self.camera.width, self.camera.height, *focal])}

    def digest(self) -> str:
        """SHA-256 of motion and points, rounded to 0.001: the same on machines that round differently."""
        digest = hashlib.sha256()
        for name in ("rotations", "translations", "points_px", "clicked_px"):
            # Adding zero makes one zero of two.
            digest.update((np.round(getattr(self, name), 3) + 0.0).tobytes())
        return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class FilmedHead:
    """A video with its truth.

    Attributes
    ----------
    frames : ndarray of uint8, shape (F, H, W, 3)
        Blue, green, red, as OpenCV has them.
    truth : VideoTruth
    parameters : VideoParameters
    """

    frames: Image
    truth: VideoTruth
    parameters: VideoParameters


def video_parameters(preset: str, overrides: Mapping[str, Any]) -> VideoParameters:
    """Parameters of a preset with overrides.

    Raises
    ------
    EvalkitError
        If the preset or an override is not known or a value does not fit.
    """
    if preset not in VIDEO_PRESETS:
        raise EvalkitError(unknown("preset", preset, list(VIDEO_PRESETS)))
    return VIDEO_PRESETS[preset].parameters.replaced(overrides)


@lru_cache(maxsize=2)
def film(parameters: VideoParameters, seed: int = 0) -> FilmedHead:
    """Film a head.

    Parameters
    ----------
    parameters : VideoParameters
    seed : int

    Returns
    -------
    FilmedHead

    Raises
    ------
    EvalkitError
        If the head is not here, or nothing can be drawn without a screen.
    """
    truth, seen = _filmed(parameters, seed)
    frames = compressed(seen, parameters.rate_hz, parameters.crf)
    return FilmedHead(np.ascontiguousarray(frames[..., ::-1]), truth, parameters)


def acted(parameters: VideoParameters, seed: int = 0) -> Performance:
    """What the head of a film does, at the middle of every frame's exposure: its true vertices in the head's axes."""
    performance = _acted(parameters, seed)[0]
    steps = performance.frames // parameters.frames
    strengths = {unit: curve[steps // 2 :: steps] for unit, curve in performance.strengths.items()}
    return Performance(performance.face, strengths, parameters.rate_hz)


def _filmed(parameters: VideoParameters, seed: int) -> tuple[VideoTruth, list[Image]]:
    """The truth, and what the sensor saw, red, green, blue, before any encoder."""
    performance, rotations, translations = _acted(parameters, seed)
    truth, raw = _shot(parameters, performance, rotations, translations, seed)
    lit = gains(_times(parameters), parameters.flicker, seed)
    random = generator("video", "noise", seed=seed)
    return truth, [sensed(picture, gain, parameters.noise, random) for picture, gain in zip(raw, lit, strict=True)]


def _times(parameters: VideoParameters) -> Array:
    return np.arange(parameters.frames) / parameters.rate_hz


def _acted(parameters: VideoParameters, seed: int) -> tuple[Performance, Array, Array]:
    """Expression, rotations and translations at the middle of every frame's exposure and around it.

    Motion blur needs poses between frames: all of them are functions of time, at :data:`SUBFRAMES` times a frame.
    """
    p = parameters
    steps = SUBFRAMES if p.shutter else 1
    within = p.shutter * ((np.arange(steps) + 0.5) / steps - 0.5) / p.rate_hz
    frame_times = _times(p)
    times = np.maximum((frame_times[:, None] + within).ravel(), 0.0)
    begun = minimum_jerk(times / SETTLED_S)
    start = generator("video", "start", seed=seed).standard_normal(3) * START_DEG
    angles = start + begun[:, None] * (_angles(frame_times, times, p, seed) - start)
    # A head that is told to stay about an axis stays there, however it started.
    angles = np.where(np.array(p.range_deg) == 0.0, start, angles)
    rotations = rotations_from_angles(angles)
    swayed = np.stack(
        [hum(times, DRIFT_HZ, generator("video", "sway", axis, seed=seed)) for axis in "xyz"], axis=1
    )  # fmt: skip
    middle = np.array([0.0, -MIDDLE[1], -p.distance_mm]) + begun[:, None] * p.drift_mm * swayed
    translations = middle + PIVOT - rotations @ PIVOT
    translations[:, 0] += _absence(times, p) * _way_out(p)
    face = filmed_face(p.head)
    actions = p.actions if p.expression else ()
    if actions:
        made = perform(face, p.frames, p.rate_hz, actions, p.expression, p.liveliness, seed=seed)
        begun_frames = minimum_jerk(frame_times / SETTLED_S)
        strengths = {unit: np.interp(times, frame_times, begun_frames * c) for unit, c in made.strengths.items()}
    else:
        strengths = {face.units[0]: np.zeros(len(times))}
    return Performance(face, strengths, p.rate_hz * steps), rotations, translations


def _angles(frame_times: Array, times: Array, p: VideoParameters, seed: int) -> Array:
    """Nod, turn and tilt at any times, from those of the frames: cubic, since postures change smoothly."""
    from scipy.interpolate import CubicSpline

    made = head_angles(frame_times, p.range_deg, p.speed, seed)
    return np.asarray(CubicSpline(frame_times, made)(np.minimum(times, frame_times[-1])))


def _absence(times: Array, p: VideoParameters) -> Array:
    """How far the head is out of the picture, 0 to 1: away in the middle of the video."""
    if not p.away:
        return np.zeros(len(times))
    length = p.frames / p.rate_hz
    first, third = 0.5 * length * (1.0 - p.away), 0.25 * p.away * length
    return minimum_jerk((times - first) / third) - minimum_jerk((times - first - 3.0 * third) / third)


def _way_out(p: VideoParameters) -> float:
    """How far to the side a head at this distance has to go to be out of the picture, mm."""
    return float(p.distance_mm * 0.5 * p.width / p.camera.focal_px + 1.2 * FACE_MM)


def _shot(
    p: VideoParameters, performance: Performance, rotations: Array, translations: Array, seed: int
) -> tuple[VideoTruth, Iterator[Image]]:
    """The truth of every frame, and its pictures before the sensor, red, green, blue, one after the other."""
    face, camera = performance.face, p.camera
    steps = len(rotations) // p.frames
    middle = slice(steps // 2, None, steps)
    sources = point_sources(face.head)
    which = np.concatenate(sources)
    at = np.repeat(np.arange(len(sources)), [len(source) for source in sources])
    strengths = {unit: curve[middle] for unit, curve in performance.strengths.items()}
    face_mm = _means(face.positions(strengths, which), at)
    r, t = rotations[middle], translations[middle]
    points_px = camera.project(apply_motion(r, t, face_mm))
    normals = _means(_normals(face.head.vertices, face.head.triangles)[which][None], at)[0]
    views = apply_motion(r, t, face_mm)
    facing = -np.einsum("fpi,fpi->fp", np.einsum("fij,pj->fpi", r, normals), views) / np.linalg.norm(views, axis=2)
    size = np.array([p.width, p.height])
    inside = ((points_px >= 0.0) & (points_px < size)).all(axis=2)
    sprite, path = _occluder(p, points_px, seed)
    hidden = _under(sprite, path, points_px)
    centre = camera.project(apply_motion(r, t, np.broadcast_to(MIDDLE, (p.frames, 1, 3))))[:, 0]
    clicks = generator("video", "clicks", seed=seed).standard_normal((len(sources), 2))
    truth = VideoTruth(
        rotations=r, translations=t, face_mm=face_mm, points_px=points_px,
        neutral_mm=_means(face.head.vertices[which][None], at)[0],
        visible=inside & (facing > FACING) & ~hidden,
        present=np.all((centre >= 0.0) & (centre < size), axis=1),
        covered=(hidden & inside).sum(axis=1) / np.maximum(inside.sum(axis=1), 1),
        rate_hz=p.rate_hz, clicked_px=points_px[0] + p.click_px * clicks, camera=camera,
    )  # fmt: skip
    return truth, _pictures(p, performance, rotations, translations, sprite, path, seed)


def _means(values: Array, at: Indices) -> Array:
    """Mean of the values (f, n, 3) that belong to each point, (f, points, 3)."""
    first = np.flatnonzero(np.diff(at, prepend=-1))
    return np.add.reduceat(values, first, axis=1) / np.bincount(at)[:, None]


def _normals(vertices: Array, triangles: Indices) -> Array:
    from evalkit.render.head_scene import VertexNormals

    return np.asarray(VertexNormals(triangles, len(vertices))(vertices.astype(np.float32)), dtype=np.float64)


def _occluder(p: VideoParameters, points_px: Array, seed: int) -> tuple[Image | None, Array]:
    """What passes before the face, and its upper left corner in every frame, (F, 2), pixels.

    It crosses in the middle half of the video, from one side to the other, with its upper part over eyes and mouth.
    """
    if p.occluder == "none":
        return None, np.zeros((p.frames, 2))
    face_px = p.camera.focal_px * FACE_MM / p.distance_mm
    sprite = occluder_sprite(p.occluder, face_px, seed)
    random = generator("video", "occluder", "way", seed=seed)
    share = np.clip((np.arange(p.frames) / (p.frames - 1) - 0.25) / 0.5, 0.0, 1.0)
    if random.random() < 0.5:
        share = 1.0 - share
    width = sprite.shape[1]
    left = -width + share * (p.width + width)
    top = np.median(points_px[:, :, 1]) - random.uniform(0.35, 0.75) * face_px
    return sprite, np.stack([left, np.full(p.frames, top)], axis=1)


def _under(sprite: Image | None, path: Array, points_px: Array) -> NDArray[np.bool_]:
    """Which points are behind the sprite, (F, P)."""
    hidden = np.zeros(points_px.shape[:2], dtype=bool)
    if sprite is None:
        return hidden
    column, row = np.moveaxis(np.floor(points_px - path[:, None]).astype(int), 2, 0)
    within = (column >= 0) & (row >= 0) & (column < sprite.shape[1]) & (row < sprite.shape[0])
    hidden[within] = sprite[row[within], column[within], 3] > 127
    return hidden


def _pictures(
    p: VideoParameters, performance: Performance, rotations: Array, translations: Array,
    sprite: Image | None, path: Array, seed: int,
) -> Iterator[Image]:  # fmt: skip
    """Every frame, (H, W, 3): the mean of the pictures of its exposure, with the occluder before it."""
    size = (p.width, p.height)
    steps = len(rotations) // p.frames
    exposed: list[Image] = []
    with CameraScene(
        performance.face.head, p.camera, p.light, clutter(size, seed), p.distance_mm, projected=p.head in PROJECTED
    ) as scene:
        for part, batch in performance.batches():
            for k, vertices in zip(range(part.start, part.stop), batch, strict=True):
                scene.pose(rotations[k], translations[k])
                exposed.append(scene.frame(vertices))
                if len(exposed) == steps:
                    picture = exposed[0] if steps == 1 else np.mean(exposed, axis=0).round().astype(np.uint8)
                    yield picture if sprite is None else covered(picture, sprite, *path[k // steps])[0]
                    exposed = []


def write_video(preset: str, directory: str | Path, seed: int = 0, **overrides: Any) -> list[Path]:
    """Film a preset into files: ``PRESET.mp4``, ``.truth.npz``, ``.truth.csv``, ``.points.json`` and ``.json``.

    The points are those of the first frame as a user places them, in the format of :mod:`evalkit.head.points`. The
    JSON holds parameters, seed, version, units and checksums. With ``crf=0`` the encoder keeps everything but the
    finer half of the colours, which no file of this kind has.

    Raises
    ------
    EvalkitError
        As :func:`film`, or if the directory cannot be written.
    """
    p = video_parameters(preset, overrides)
    directory = Path(directory)
    with staged(directory) as stage:
        truth, seen = _filmed(p, seed)
        write_h264(seen, stage / f"{preset}.mp4", p.rate_hz, p.crf)
        np.savez_compressed(stage / f"{preset}.truth.npz", **truth.arrays())
        _write_csv(truth, stage / f"{preset}.truth.csv")
        places = {name: place.round(2).tolist() for name, place in zip(FACE_POINTS, truth.clicked_px, strict=True)}
        write_json({"points": places}, stage / f"{preset}.points.json")
        write_json({**described(preset, p, seed), "sha256_of_truth": truth.digest()}, stage / f"{preset}.json")
        names = sorted(path.name for path in stage.iterdir())
    return [directory / name for name in names]


def manifest(seed: int = 0) -> dict[str, Any]:
    """Every preset with its parameters, seed and the checksum of its truth; no picture is drawn for it."""
    made = []
    for preset, entry in VIDEO_PRESETS.items():
        truth = _shot(entry.parameters, *_acted(entry.parameters, seed), seed)[0]
        command = f"evalkit synth {preset} -o DIR --seed {seed}"
        made.append(
            {**described(preset, entry.parameters, seed), "command": command, "sha256_of_truth": truth.digest()}
        )
    return {"videos": made}


def described(preset: str, parameters: VideoParameters, seed: int) -> dict[str, Any]:
    """What is written about a video beside it and in the manifest."""
    return {
        "preset": preset,
        "about": VIDEO_PRESETS[preset].text,
        "seed": seed,
        "parameters": dataclasses.asdict(parameters),
        "evalkit_version": __version__,
        "units": {"length": "mm", "angle": "deg", "time": "s", "rate": "Hz", "picture": "px"},
        "axes": {"x": "person's left", "y": "up", "z": "towards the camera, which is at the origin"},
    }


def _write_csv(truth: VideoTruth, path: Path) -> None:
    """Pose of every frame: the angles of ``R = R_y(turn) R_x(nod) R_z(tilt)``, degrees, and T, mm."""
    from scipy.spatial.transform import Rotation

    frames = np.arange(len(truth.rotations))
    angles = Rotation.from_matrix(truth.rotations).as_euler("YXZ", degrees=True)[:, [1, 0, 2]]
    table = np.column_stack(
        [frames, frames / truth.rate_hz, angles, truth.translations, truth.present, truth.covered]
    )  # fmt: skip
    head = "frame,time_s,nod_deg,turn_deg,tilt_deg,tx_mm,ty_mm,tz_mm,present,covered"
    np.savetxt(path, table, ["%d", *["%.6f"] * 7, "%d", "%.4f"], ",", header=head, comments="")


if __name__ == "__main__":
    print(json.dumps(manifest(), indent=2))
