"""How near the pivot estimators come to the Cramér-Rao bound, and what a good pivot is worth for the expression.

Two experiments on synthetic takes (600 frames, 60 Hz, three forehead markers), every one over the same seeds:

``still``
    A neck at rest. Error of each pivot estimator against the bound, over noise and range of motion.
``sway``
    A neck that drifts. Error of the pivot against the bound with the spline that was used, of the rotation, and of
    the expression on the markers that the estimate did not see.

Every figure comes with its number of seeds and a bootstrap interval over them. Run it by
``python -m evalkit.studies.calibration``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.capture.origin import local_origin
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, cross_matrix, undo_motion
from evalkit.metrics import expression_error_mm, rms, rotation_error_deg
from evalkit.pivot import Pivot, pivot_estimators
from evalkit.pivot.bound import full_pivot_bound, inertia
from evalkit.pivot.spline import constant, cubic
from evalkit.pose import Pose, pose_estimators, reference_pose
from evalkit.pose.smooth import smooth
from evalkit.results import check_output, staged
from evalkit.seeds import generator
from evalkit.synthetic import synthesize

Row = dict[str, Any]
Cell = tuple[str, float, float, float, int]
"""Experiment, noise (mm), range (deg), sway (mm), seed."""

NOISES = (0.1, 0.3, 1.0)
RANGES = (20.0, 5.0, 2.0)
SWAYS = (0.0, 5.0, 20.0)
SPACINGS = (2.5, 1.25, 0.625, 0.3125)
"""Knot spacings tried beside the automatic choice, s."""

RESAMPLES = 4000
"""Bootstrap draws; the ends of a 95 % interval then vary by a few percent of its width."""

PAPER = "six-directions, frame 0"
STILL_METHODS = (PAPER, "svd", "score", "sphere", "gamage-lasenby", "joint none", "joint auto")
SMOOTHED = "joint auto, smoothed"
SWAY_METHODS = (PAPER, "svd", "joint none", "joint auto", SMOOTHED, *(f"joint {spacing:g} s" for spacing in SPACINGS))

REQUIRED: tuple[tuple[str, str, str, str, float], ...] = (
    *(("still", f"noise {noise:g}, range 20, sway 0", "joint none", "efficiency at least", 0.9) for noise in NOISES),
    ("sway", "noise 0.3, range 20, sway 20", "joint auto", "error over bound at most", 1.3),
    ("sway", "noise 0.3, range 20, sway 20", "joint auto", "expression over per-frame at most", 0.45),
    ("sway", "noise 0.3, range 20, sway 20", SMOOTHED, "expression over per-frame at most", 0.45),
    *(("still", f"noise {noise:g}, range 20, sway 0", "joint auto", "over no sway at most", 1.05) for noise in NOISES),
)
"""Experiment, condition, method, figure and the limit that is expected of it."""


SHOWN = {
    "still": ("pivot error mm", "bound mm", "efficiency", "efficiency of the trace", "error over stated"),
    "sway": ("pivot error mm", "error over bound", "rotation deg", "expression mm", "expression over per-frame"),
}
"""Figures of the printed tables; the CSV has all."""


def cells(seeds: int) -> list[Cell]:
    """Every experiment, condition and seed."""
    still = [("still", noise, reach, 0.0, seed) for reach in RANGES for noise in NOISES for seed in range(seeds)]
    return still + [("sway", 0.3, 20.0, sway, seed) for sway in SWAYS for seed in range(seeds)]


def measured(cell: Cell) -> list[Row]:
    """One row for every method on one take: its errors and the bound."""
    from threadpoolctl import threadpool_limits

    experiment, noise, reach, sway, seed = cell
    with threadpool_limits(1):  # sums in the same order on every machine and for any number of jobs
        take, truth = synthesize("talking", seed=seed, noise=noise, range_deg=reach, sway=sway)
        columns = take.indices(truth.rigid)
        others = np.setdiff1d(np.arange(len(take.labels)), columns)
        points, start = take.points[:, columns], local_origin(take, columns)
        free = reference_pose(pose_estimators["svd"], points)
        shape = truth.neutral[columns] - truth.pivot
        target = truth.pivot + truth.sway.mean(axis=0)
        rows = []
        for method in STILL_METHODS if experiment == "still" else SWAY_METHODS:
            pivot, pose = _estimated(method, points, free, take.rate, start)
            spacing = pivot.sway_spacing_s
            basis = constant(take.frames) if np.isinf(spacing) else cubic(take.frames, take.rate, spacing)
            bound = full_pivot_bound(shape, truth.rotations, noise, basis=basis)
            error = pivot.position - target
            stated = np.isfinite(pivot.covariance).all()
            row: Row = {
                "experiment": experiment, "noise_mm": noise, "range_deg": reach, "sway_mm": sway, "seed": seed,
                "method": method, "status": pivot.status, "sway_spacing_s": spacing,
                "square_mm2": float(error @ error), "bound_mm2": float(np.trace(bound)),
                "normalised": float(error @ np.linalg.solve(bound, error)) / 3.0,
                "stated": float(error @ np.linalg.pinv(pivot.covariance) @ error) / 3.0 if stated else np.nan,
            }  # fmt: skip
            if experiment == "sway":
                undone = undo_motion(pose.rotations, pose.translations, take.points[:, others])
                row["rotation_deg"] = rms(rotation_error_deg(pose.rotations, truth.rotations))
                row["expression_mm"] = rms(expression_error_mm(undone, truth.clean[:, others]))
                row["expression_bound_mm"] = expression_bound(shape, truth.clean[:, others] - truth.pivot, noise)
            rows.append(row)
    return rows


def expression_bound(shape: Array, markers: Array, sigma_mm: float) -> float:
    """Smallest rms error of compensated markers, mm: shape and path of the pivot known, each frame's turn not.

    ``3 sigma² + sigma² trace([d]x J_p^-1 [d]x')`` on average over the markers d about the pivot, (F, M, 3): their
    own noise, and the turn estimated from rigid markers of inertia J_p. Frames that share what they know of the
    turn, by a model of how a head moves, could do better.
    """
    lever = cross_matrix(markers.reshape(-1, 3))
    turned = np.einsum("nij,jk,nik->n", lever, np.linalg.inv(inertia(shape)), lever, optimize=True)
    return sigma_mm * float(np.sqrt(3.0 + turned.mean()))


def _estimated(method: str, points: Array, free: Pose, rate: float, start: Array) -> tuple[Pivot, Pose]:
    """Pivot and pose of every frame by one method; for methods that give none, the pose that they started from."""
    if method == PAPER:
        pose = reference_pose(pose_estimators["translation-invariants"], points, 0)
        return pivot_estimators["six-directions"](points, pose, initial=start, origin=start, reference=0), pose
    if method == SMOOTHED:
        pivot, pose = _estimated("joint auto", points, free, rate, start)
        return pivot, smooth(pose, points, rate=rate, about=pivot.position).pose
    name, _, mode = method.partition(" ")
    sway = mode if mode in ("none", "auto") else float(mode.removesuffix(" s") or "inf")
    pivot = pivot_estimators[name](points, free, initial=start, origin=start, rate=rate, sway=sway)
    return pivot, free if pivot.pose is None else pivot.pose


def interval(columns: Array, figure: Callable[[Array], Array]) -> tuple[float, float, float]:
    """A figure made of the means of columns (N, K), with its bootstrap 95 % interval over the N seeds.

    Parameters
    ----------
    columns : ndarray, shape (N, K)
        One row per seed.
    figure : callable
        From means (..., K) to the figure (...).

    Returns
    -------
    (float, float, float)
        Figure, lower and upper end.

    References
    ----------
    Efron & Tibshirani, "An introduction to the bootstrap" (1993), chapter 13: the percentile interval.
    """
    if not len(columns):
        return float("nan"), float("nan"), float("nan")
    random = generator("calibration", "bootstrap", len(columns))
    drawn = random.integers(0, len(columns), (RESAMPLES, len(columns)))
    low, high = np.quantile(figure(columns[drawn].mean(axis=1)), [0.025, 0.975])
    return float(figure(columns.mean(axis=0))), float(low), float(high)


def summarised(rows: list[Row]) -> list[Row]:
    """One row per experiment, condition, method and figure."""
    groups: dict[tuple[str, str], dict[str, list[Row]]] = {}
    for row in rows:
        condition = f"noise {row['noise_mm']:g}, range {row['range_deg']:g}, sway {row['sway_mm']:g}"
        groups.setdefault((row["experiment"], condition), {}).setdefault(row["method"], []).append(row)
    out = []
    for (experiment, condition), methods in groups.items():
        for method, mine in methods.items():
            for name, columns, figure in _figures(mine, methods):
                value, low, high = interval(columns, figure)
                out.append(
                    {
                        "experiment": experiment, "condition": condition, "method": method, "figure": name,
                        "value": value, "low": low, "high": high, "seeds": len(columns),
                        "unobservable": sum(row["status"] == "unobservable" for row in mine),
                        "splines": sum(np.isfinite(row["sway_spacing_s"]) for row in mine),
                    }
                )  # fmt: skip
    return out


def _figures(mine: list[Row], methods: dict[str, list[Row]]) -> Iterator[tuple[str, Array, Callable[[Array], Array]]]:
    """Name, columns to average and what to make of the means, for the takes of one method and condition."""

    def column(name: str, rows: list[Row] = mine) -> Array:
        return np.array([row[name] for row in rows], dtype=np.float64)

    def root(means: Array) -> Array:
        return np.sqrt(means[..., 0])

    def ratio(means: Array) -> Array:
        return np.sqrt(means[..., 0] / means[..., 1])

    square, bound = column("square_mm2"), column("bound_mm2")
    yield "pivot error mm", square[:, None], root
    yield "bound mm", bound[:, None], root
    yield "efficiency", column("normalised")[:, None], lambda means: 1.0 / means[..., 0]
    yield "efficiency of the trace", np.stack([bound, square], axis=1), lambda means: means[..., 0] / means[..., 1]
    yield "error over bound", np.stack([square, bound], axis=1), ratio
    stated = column("stated")
    yield "error over stated", stated[np.isfinite(stated), None], root
    if "joint none" in methods and mine[0]["method"].startswith("joint"):
        still = column("square_mm2", methods["joint none"])
        yield "over no sway", np.stack([square, still], axis=1), ratio
    if "expression_mm" in mine[0]:
        yield "rotation deg", column("rotation_deg")[:, None] ** 2, root
        expression = column("expression_mm") ** 2
        yield "expression mm", expression[:, None], root
        yield "expression bound mm", column("expression_bound_mm")[:, None] ** 2, root
        free = column("expression_mm", methods["svd"]) ** 2
        yield "expression over per-frame", np.stack([expression, free], axis=1), ratio
        least = column("expression_bound_mm") ** 2
        yield "expression bound over per-frame", np.stack([least, free], axis=1), ratio


def verdicts(summary: list[Row]) -> Iterator[tuple[str, bool]]:
    """Each expectation in words, and whether it is met."""
    for experiment, condition, method, what, limit in REQUIRED:
        figure, least = what.removesuffix(" at least").removesuffix(" at most"), what.endswith("least")
        for row in summary:
            if (row["experiment"], row["condition"], row["method"], row["figure"]) == (
                experiment, condition, method, figure,
            ):  # fmt: skip
                met = row["value"] >= limit if least else row["value"] <= limit
                yield f"{experiment}, {condition}, {method}: {what} {limit:g} - {_text(row)}", bool(met)


def _text(row: Row) -> str:
    return f"{row['value']:.3g} [{row['low']:.3g}, {row['high']:.3g}]"


def printed(summary: list[Row]) -> str:
    """The figures of :data:`SHOWN` as text, one table per experiment and condition."""
    lines = []
    for key in dict.fromkeys((row["experiment"], row["condition"]) for row in summary):
        mine = [row for row in summary if (row["experiment"], row["condition"]) == key]
        shown = SHOWN[key[0]]
        lines += ["", f"{key[0]}: {key[1]}", f"{'':<24}" + "".join(f"{name:>31}" for name in shown)]
        for method in dict.fromkeys(row["method"] for row in mine):
            found = {row["figure"]: row for row in mine if row["method"] == method}
            first = next(iter(found.values()))
            notes = [f"{first['seeds']} seeds"]
            notes += [f"{first['splines']} with sway"] if method.startswith("joint") else []
            notes += [f"{first['unobservable']} called unobservable"] if first["unobservable"] else []
            line = f"{method:<24}" + "".join(f"{_text(found[name]):>31}" for name in shown)
            lines.append(f"{line}  {', '.join(notes)}")
    return "\n".join(lines[1:])


def run(seeds: int, jobs: int = -1) -> list[Row]:
    """All rows, in the order of the cells; a progress bar if the output is a terminal."""
    from joblib import Parallel, delayed
    from rich.console import Console
    from rich.progress import track

    work = cells(seeds)
    done = Parallel(n_jobs=jobs, return_as="generator", batch_size=4)(delayed(measured)(cell) for cell in work)
    console = Console(stderr=True)
    bar = track(done, "takes", len(work), console=console, disable=not console.is_terminal)
    return [row for rows in bar for row in rows]


def write_csv(rows: list[Row], path: Path) -> None:
    """Rows as CSV under the union of their keys."""
    import csv

    keys = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, keys)
        writer.writeheader()
        writer.writerows(rows)


def main(arguments: list[str] | None = None) -> int:
    """Run the study; 0 if all expectations are met, 1 if one is not, 2 for wrong usage."""
    parser = argparse.ArgumentParser(
        prog="python -m evalkit.studies.calibration",
        description="Pivot estimators against the Cramér-Rao bound, and the worth of a good pivot.",
        epilog="Example: python -m evalkit.studies.calibration --seeds 50 -o results",
    )
    parser.add_argument("--seeds", type=int, default=50, help="takes per condition (50; at least 2)")
    parser.add_argument("--jobs", type=int, default=-1, help="processes; -1 is one per core (default)")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="folder for the CSV files")
    given = parser.parse_args(arguments)
    if given.seeds < 2:
        parser.error("--seeds must be at least 2: an interval needs a spread")
    if given.jobs == 0:
        parser.error("--jobs must not be 0")
    try:
        if given.output is not None:
            check_output(given.output)
        rows = run(given.seeds, given.jobs)
        summary = summarised(rows)
        if given.output is not None:
            with staged(given.output) as folder:
                write_csv(summary, folder / "calibration.csv")
                write_csv(rows, folder / "calibration-takes.csv")
    except EvalkitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(printed(summary))
    print("\nexpected (value and bootstrap 95 % interval over seeds)")
    found = list(verdicts(summary))
    for words, met in found:
        print(f"{'met    ' if met else 'NOT MET'} {words}")
    return 0 if all(met for _, met in found) else 1


if __name__ == "__main__":
    sys.exit(main())
