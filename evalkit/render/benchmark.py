"""How many frames of an animated head per second: deform, upload, render, read the pixels back, each timed.

A rate counts only with the proof that every frame was drawn: the checksums of all read-back pictures differ. The
limit is measured in the same run: the same scene drawn and read back by a bare loop that deforms and uploads
nothing. Both loops take turns in short blocks, so that whatever else the machine does hits both.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit.deform import Deformer, deformation_map, performer_scaling
from evalkit.deform.centres import site_positions, static_positions
from evalkit.geometry import Array, nearest_rotation
from evalkit.head import Head, load_head
from evalkit.render.head_scene import HeadScene

STAGES = ("deform", "upload", "render", "read_back")
PERCENTILES = (50, 95, 99)

FRAMES = 100
FULL_FRAMES = 300
SIZES = (512, 1024)
MULTISAMPLES = (0, 8)
FULL_VERTICES = (1_000, 5_000, 20_000, 100_000)

BLOCK = 10
"""Frames of one loop before the other takes its turn."""

LEAST_TAKE = 600
"""Frames that are compensated at least, ten seconds."""

WARM_UP = 3
"""Frames that are not counted: shaders are compiled and buffers made in the first."""

REPEATS = 15
"""Rounds over the rates of arithmetic. The fastest product stands for each, since whatever else the machine does only
makes one slower; what the loop itself reaches is in the percentiles."""

ONE_BY_ONE = 20
"""Single frames deformed in each round."""

PEAK_SIZES = (256, 512, 1024)
"""Rows and columns of the square products whose best rate is the machine's. Larger ones are no faster; the small ones
take a millisecond or less, which a busy machine leaves undisturbed now and then."""

STILL_MM = 0.2
"""Step of the bare loop's head. VTK draws anew whenever it is asked; the step is there to show it in the pixels."""

NOT_DRAWN = "pictures repeat"
"""Status of a row in which not every frame gave a picture of its own; it has no rates."""


@dataclass(frozen=True)
class Setting:
    """One row of the benchmark.

    Attributes
    ----------
    vertices : int, optional
        Resolution asked of the template; its own by default.
    size : int
        Width and height of the picture, pixels.
    textured : bool
    multisamples : int
    """

    vertices: int | None = None
    size: int = 1024
    textured: bool = True
    multisamples: int = 0


def settings(
    vertices: Iterable[int | None], sizes: Iterable[int], textured: Iterable[bool], multisamples: Iterable[int]
) -> list[Setting]:
    """All combinations; those of one head stand together."""
    return [Setting(*values) for values in product(vertices, sizes, textured, multisamples)]


def benchmark(wanted: Iterable[Setting], frames: int = FRAMES) -> Iterator[dict[str, Any]]:
    """Measure one setting after the other.

    Parameters
    ----------
    wanted : iterable of Setting
        A head is made anew when its resolution changes.
    frames : int
        Counted frames of each.

    Yields
    ------
    dict
        One row: the setting, then :func:`measure`, :func:`deformation_rates`, the renderer and the versions.

    Raises
    ------
    EvalkitError
        If there is no such resolution, or nothing can be drawn without a screen here.
    """
    made: Animation | None = None
    last: int | None = None
    rates: dict[str, float] = {}
    for setting in wanted:
        if made is None or setting.vertices != last:
            made, last = animate(load_head(vertices=setting.vertices), frames + WARM_UP), setting.vertices
            rates = deformation_rates(made)
        with HeadScene(
            made.head, (setting.size, setting.size), textured=setting.textured, multisamples=setting.multisamples
        ) as scene:
            row, renderer = measure(scene, made), scene.renderer
        yield {
            "vertices": len(made.head.vertices),
            "centres": made.displacements.shape[1],
            "width": setting.size,
            "height": setting.size,
            "textured": setting.textured,
            "multisamples": setting.multisamples,
            **row,
            **rates,
            "renderer": renderer,
            "vtk": version("vtk"),
            "pyvista": version("pyvista"),
        }


@dataclass(frozen=True, eq=False)
class Animation:
    """A head and what moves it.

    Attributes
    ----------
    head : Head
    weights : ndarray, shape (V, n)
        Deformation map.
    displacements : ndarray of float32, shape (F, n, 3), mm
        Of the centres, frame by frame.
    """

    head: Head
    weights: Array
    displacements: NDArray[np.float32]


def animate(head: Head, frames: int) -> Animation:
    """The expression of a talking performer, compensated and scaled, on a head.

    The static centres stand in the map with columns of their own, as in the paper, though their displacement is
    zero: 43 centres in all.

    Parameters
    ----------
    head : Head
    frames : int

    Returns
    -------
    Animation
    """
    from evalkit.compensation import compensate
    from evalkit.synthetic import synthesize

    # Long enough to find the pivot in, and so the same performance for any smaller number of frames.
    take, truth = synthesize("talking", frames=max(frames, LEAST_TAKE))
    labels = list(take.labels)
    played = compensate(take, list(truth.rigid)).capture.points
    sites = site_positions(head)
    on_head = np.array([sites[label] for label in labels])
    neutral = np.median(played, axis=0)
    # The reference pose is one of the take's own; the head looks straight ahead.
    turn = nearest_rotation((on_head - on_head.mean(axis=0)).T @ (neutral - neutral.mean(axis=0)))
    scales = performer_scaling(head, dict(zip(labels, neutral @ turn.T, strict=True))).scales
    moving = (played[:frames] - neutral) @ turn.T * scales
    still = static_positions(head, True, on_head)
    places = dict(zip(labels, on_head, strict=True)) | {f"static {k}": place for k, place in enumerate(still)}
    weights = deformation_map(head, places, static=False)
    displacements = np.zeros((frames, len(places), 3), dtype=np.float32)
    displacements[:, : len(labels)] = moving
    return Animation(head, weights, displacements)


def measure(scene: HeadScene, animation: Animation) -> dict[str, Any]:
    """Time an animation in a scene.

    The head itself does not move, so that nothing but its deformation tells one picture from the next. What is
    timed is the four stages; the checksums are taken between frames and cost no rate.

    Parameters
    ----------
    scene : HeadScene
    animation : Animation
        The first :data:`WARM_UP` frames are not counted.

    Returns
    -------
    dict
        ``status`` is ``ok`` or :data:`NOT_DRAWN`, with which every rate is None. ``distinct_frames`` are
        different pictures among ``frames``, ``bare_distinct_frames`` those of the bare loop.
        ``frames_per_second`` is of the four stages together, ``bare_frames_per_second`` of rendering and reading
        back alone. ``<stage>_ms_p50`` and so on are percentiles over the frames of each of :data:`STAGES`.
    """
    deformer = Deformer(animation.weights, animation.head.vertices, dtype=np.float32)
    displacements = animation.displacements
    for k in range(WARM_UP):
        scene.frame(deformer(displacements[k]))
    counted = range(WARM_UP, len(displacements))
    seconds, bare_seconds = [], []
    pictures, bare_pictures = set(), set()
    for start in range(0, len(counted), BLOCK):
        block = counted[start : start + BLOCK]
        scene.pose(np.eye(3), np.zeros(3))
        for k in block:
            spent, picture = _frame(scene, deformer, displacements[k])
            seconds.append(spent)
            pictures.add(_checksum(picture))
        for k in block:
            spent_bare, picture = _bare_frame(scene, STILL_MM * (k - len(counted) / 2) / len(counted))
            bare_seconds.append(spent_bare)
            bare_pictures.add(_checksum(picture))
    drawn = len(pictures) == len(bare_pictures) == len(counted)
    figures: dict[str, Any] = {
        "frames_per_second": len(counted) / np.sum(seconds),
        "bare_frames_per_second": len(counted) / np.sum(bare_seconds),
    }
    for stage, column in zip(STAGES, np.transpose(seconds), strict=True):
        figures |= {f"{stage}_ms_p{p}": 1e3 * np.percentile(column, p) for p in PERCENTILES}
    return {
        "status": "ok" if drawn else NOT_DRAWN,
        "frames": len(counted),
        "distinct_frames": len(pictures),
        "bare_distinct_frames": len(bare_pictures),
        **{name: float(value) if drawn else None for name, value in figures.items()},
    }


def _frame(scene: HeadScene, deformer: Deformer, displacement: Array) -> tuple[list[float], NDArray[np.uint8]]:
    """Seconds of every stage, and the picture."""
    times = [perf_counter()]
    vertices = deformer(displacement)
    times.append(perf_counter())
    scene.show(vertices)
    times.append(perf_counter())
    scene.render()
    times.append(perf_counter())
    picture = scene.read()
    times.append(perf_counter())
    return list(np.diff(times)), picture


def _bare_frame(scene: HeadScene, shift_mm: float) -> tuple[float, NDArray[np.uint8]]:
    """Seconds of rendering and reading back alone, and the picture."""
    scene.pose(np.eye(3), [shift_mm, 0.0, 0.0])
    start = perf_counter()
    scene.render()
    picture = scene.read()
    return perf_counter() - start, picture


def _checksum(picture: NDArray[np.uint8]) -> bytes:
    return hashlib.sha256(picture.tobytes()).digest()


def deformation_rates(animation: Animation, repeats: int = REPEATS) -> dict[str, float]:
    """Rates of the deformation alone, against what the machine can do.

    Returns
    -------
    dict
        ``deform_frames_per_second_one`` and ``_batched``: a frame at a time, and in batches. ``gemm_gflops`` is the
        rate of the latter, counting the products of weights and displacements alone; ``peak_gflops`` that of a large
        square product by the same library.
    """
    deformer = Deformer(animation.weights, animation.head.vertices, dtype=np.float32)
    displacements = animation.displacements
    squares = [np.ones((size, size), dtype=np.float32) for size in PEAK_SIZES]
    peak, batched, one = [], [], []
    for _ in range(repeats):
        for square in squares:
            result = np.empty_like(square)
            for _ in range(len(squares[-1]) // len(square)):
                start = perf_counter()
                np.matmul(square, square, out=result)
                peak.append((perf_counter() - start) / len(square) ** 3)
        start = perf_counter()
        for _, positions in deformer.batches(displacements):
            batched.append((perf_counter() - start) / len(positions))
            start = perf_counter()
        for displacement in displacements[:ONE_BY_ONE]:
            start = perf_counter()
            deformer(displacement)
            one.append(perf_counter() - start)
    flops = 2 * 3 * animation.weights.size
    return {
        "deform_frames_per_second_one": 1 / min(one),
        "deform_frames_per_second_batched": 1 / min(batched),
        "gemm_gflops": 1e-9 * flops / min(batched),
        "peak_gflops": 1e-9 * 2 / min(peak),
    }
