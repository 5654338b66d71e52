"""A motion database: control parameters and marker displacements of any number of takes, in files opened by mapping.

A database is a folder: ``motions.npy`` and ``changes.npy`` (rows of all takes, one after the other), a file of the
normalised parameters, and ``takes.json``, which says what the rows are. It grows by rows at the end; ``takes.json`` is
replaced last, so that a reader sees the old database or the new one.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evalkit import __version__
from evalkit.animation.gaps import SHORT_GAP_S
from evalkit.capture import Capture, read_capture
from evalkit.control.takes import SHORTEST_S, DatabaseTake, TakeOptions, database_take
from evalkit.errors import EvalkitError
from evalkit.geometry import Array, blocks
from evalkit.results import check_output, file_sha256, staged, write_json
from evalkit.vision.parameters import NAMES, PARAMETERS

FORMAT, VERSION = "evalkit motion database", 1
MANIFEST = "takes.json"

STILL = np.array([3.0 if p.unit == "deg" else 0.1 if p.form == "ratio" else 0.03 for p in PARAMETERS])
"""Least spread of each parameter: degrees, parts of a length, eye distances (2 mm). It is about what parameters that
are read from a video are wrong by (study ``parameters``): where a database moves less, a tracker's noise must not count
for more than all that moves."""

ANSWER_S = 10.0
"""How long a scheduler may take to answer, s."""

Source = Capture | str | Path


@dataclass(frozen=True, eq=False)
class StoredTake:
    """A take of a database.

    Attributes
    ----------
    name : str
    performer : str
        Empty if nobody said who.
    start, stop : int
        Its rows.
    neutral : ndarray, shape (15,)
        Control parameters of its neutral face; NaN where not known.
    rest_mm : ndarray, shape (M, 3)
    facts : dict
        All that ``takes.json`` says of it.
    """

    name: str
    performer: str
    start: int
    stop: int
    neutral: Array
    rest_mm: Array
    facts: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Database:
    """Motion of a face, ready to be searched. Big arrays are mapped from files and take no memory of their own.

    Attributes
    ----------
    folder : Path
    digest : str
        SHA-256 of what it was built from and how: equal contents have equal digests.
    labels : tuple of str, length M
    rate_hz : float
    rest_mm : ndarray, shape (M, 3)
        The face at rest, mean of the takes', in frontal axes (x to the performer's left, y up, z forward), from the
        mean of the rigid markers.
    parameters : ndarray of float32, shape (N, 15)
        Of every row, against its take's own neutral and in units of the spread
        (:func:`evalkit.vision.parameters.normalise`); 0 where not known.
    spread : ndarray, shape (15,)
        Standard deviation over all rows, at least :data:`STILL`.
    known : ndarray of bool, shape (15,)
        Parameters that the markers give; the others do not count.
    motions : ndarray of float32, shape (N, M, 3), mm
        Displacement of every marker from its own take's rest, frontal axes.
    segments : ndarray of int, shape (S, 2)
        Rows [start, stop) of unbroken motion; together they are all rows.
    takes : tuple of StoredTake
    """

    folder: Path
    digest: str
    labels: tuple[str, ...]
    rate_hz: float
    rest_mm: Array
    parameters: NDArray[np.float32]
    spread: Array
    known: NDArray[np.bool_]
    motions: NDArray[np.float32]
    segments: NDArray[np.int64]
    takes: tuple[StoredTake, ...]

    @property
    def rows(self) -> int:
        """Number of frames."""
        return len(self.parameters)

    @property
    def unknown_parameters(self) -> list[str]:
        """Names of the parameters that the markers do not give."""
        return [name for name, known in zip(NAMES, self.known, strict=True) if not known]

    def facts(self) -> dict[str, Any]:
        """What a machine may want to know of it."""
        return {
            "folder": str(self.folder),
            "digest": self.digest,
            "rows": self.rows,
            "seconds": self.rows / self.rate_hz,
            "rate_hz": self.rate_hz,
            "segments": len(self.segments),
            "markers": list(self.labels),
            "unknown_parameters": self.unknown_parameters,
            "spread": dict(zip(NAMES, self.spread.tolist(), strict=True)),
            "bytes": sum(path.stat().st_size for path in self.folder.iterdir() if path.is_file()),
            "takes": [
                {key: value for key, value in take.facts.items() if key not in ("segments", "rest_mm", "mean", "m2")}
                | {"segments": len(take.facts["segments"])}
                for take in self.takes
            ],
        }


def open_database(
    folder: str | Path, labels: Sequence[str] | None = None, parameters: Sequence[str] | None = None
) -> Database:
    """Open a database; nothing but its description is read.

    Parameters
    ----------
    folder : path
    labels : sequence of str, optional
        Markers that it must have, in this order.
    parameters : sequence of str, optional
        Control parameters that it must know.

    Returns
    -------
    Database

    Raises
    ------
    EvalkitError
        If the folder is none, is damaged, was made by a newer evalkit, or has other markers or parameters.
    """
    folder = Path(folder)
    manifest = _read_manifest(folder)
    found = _opened(folder, manifest)
    if labels is not None and tuple(labels) != found.labels:
        other = next((label for label in labels if label not in found.labels), None)
        what = f"no marker '{other}'" if other else f"{len(found.labels)} markers in another order or number"
        raise EvalkitError(f"{folder}: the database has {what}; build one with --markers {','.join(labels[:3])},...")
    for name in parameters or ():
        if name not in NAMES:
            raise EvalkitError(f"'{name}' is no control parameter; they are {', '.join(NAMES)}")
        if name in found.unknown_parameters:
            raise EvalkitError(f"{folder}: the database's markers do not give {name}; build one from takes that do")
    return found


def _read_manifest(folder: Path) -> dict[str, Any]:
    path = folder / MANIFEST
    if not path.is_file():
        what = "holds no motion database" if folder.is_dir() else "no such folder"
        raise EvalkitError(f"{folder}: {what}; make one with: evalkit database build CAPTURES... -o {folder}")
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        kind, version = manifest["format"], int(manifest["version"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise EvalkitError(f"{path}: cannot be read ({error}); build the database again") from error
    if kind != FORMAT:
        raise EvalkitError(f"{path}: is '{kind}', not a motion database of evalkit")
    if version > VERSION:
        raise EvalkitError(f"{folder}: made by evalkit {manifest.get('evalkit')}, newer than this one; update evalkit")
    if list(manifest.get("parameters", ())) != list(NAMES):
        raise EvalkitError(f"{folder}: built with other control parameters than this evalkit has; build it again")
    return dict(manifest)


def _opened(folder: Path, manifest: dict[str, Any]) -> Database:
    try:
        rows, markers = int(manifest["rows"]), len(manifest["labels"])
        takes = tuple(_stored(entry) for entry in manifest["takes"])
        segments = [np.asarray(t.facts["segments"], dtype=np.int64).reshape(-1, 2) + t.start for t in takes]
        return Database(
            folder=folder,
            digest=manifest["digest"],
            labels=tuple(manifest["labels"]),
            rate_hz=float(manifest["rate_hz"]),
            rest_mm=np.mean([take.rest_mm for take in takes], axis=0),
            parameters=_mapped(folder / manifest["parameters_file"], rows, (len(NAMES),)),
            spread=np.array(manifest["spread"], dtype=np.float64),
            known=np.array(manifest["known"], dtype=bool),
            motions=_mapped(folder / "motions.npy", rows, (markers, 3)),
            segments=np.concatenate(segments),
            takes=takes,
        )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise EvalkitError(f"{folder / MANIFEST}: is damaged ({error}); build the database again") from error


def _stored(entry: dict[str, Any]) -> StoredTake:
    neutral = np.array([np.nan if value is None else value for value in entry["neutral"]])
    rest = np.array(entry["rest_mm"], dtype=np.float64).reshape(-1, 3)
    start, stop = map(int, entry["rows"])
    return StoredTake(entry["name"], entry["performer"], start, stop, neutral, rest, entry)


def _mapped(path: Path, rows: int, shape: tuple[int, ...]) -> NDArray[np.float32]:
    try:
        array = np.load(path, mmap_mode="r")
    except (OSError, ValueError) as error:
        raise EvalkitError(f"{path}: cannot be read ({error}); build the database again") from error
    if array.dtype != np.float32 or array.shape[1:] != shape or len(array) < rows:
        raise EvalkitError(f"{path}: is not what {MANIFEST} says (shape {array.shape}); build the database again")
    return array[:rows]


def build_database(
    captures: Mapping[str, Source] | Iterable[Source],
    output: str | Path,
    *,
    compensated: bool = False,
    rigid: str | Sequence[str] = "auto",
    performer: str = "",
    labels: Sequence[str] = (),
    rate_hz: float = 0.0,
    gap_s: float = SHORT_GAP_S,
    shortest_s: float = SHORTEST_S,
    neutral_s: float = 0.0,
    jobs: int = 1,
    scheduler: str | None = None,
    done: Callable[[str], object] | None = None,
) -> Database:
    """Build a database out of captures.

    Every worker holds one take at a time; its rows go to files and memory does not grow with their number. The result
    does not depend on ``jobs`` or the scheduler.

    Parameters
    ----------
    captures : paths or Captures, or mapping of names to them
        Read one after the other; an iterator is not stored. Without names, files give theirs, and Captures get
        numbers.
    output : path
        A new folder. It appears when all is done, or not at all.
    compensated : bool
        The captures have no head motion any more.
    rigid : "auto" or sequence of str
        Markers over bone, as of :func:`evalkit.compensate`.
    performer : str
        Whose takes they are.
    labels : sequence of str, optional
        Markers that are kept; all of the first take without it. Takes may have more, but not fewer.
    rate_hz : float, optional
        Frames a second; that of the first take without it. Takes of other rates are resampled.
    gap_s, shortest_s, neutral_s : float
        See :class:`evalkit.control.takes.TakeOptions`.
    jobs : int
        Processes on this machine; -1 is one per core.
    scheduler : str, optional
        Address of a running dask scheduler whose workers see the same files as this machine.
    done : callable, optional
        Gets the name of every take that is done.

    Returns
    -------
    Database

    Raises
    ------
    EvalkitError
        If there are no captures, one cannot be used (see :func:`evalkit.control.takes.database_take`), or the folder
        cannot be written or holds a database already.
    """
    output = Path(output)
    if (output / MANIFEST).exists():
        raise EvalkitError(f"{output}: holds a database already; add to it with: evalkit database add, or name another")
    check_output(output)
    options = TakeOptions(tuple(labels), float(rate_hz), float(gap_s), float(shortest_s), float(neutral_s))
    _check(options)
    work = _Work(captures, compensated, rigid, performer, jobs, scheduler, done or (lambda name: None))
    with staged(output) as stage:
        parts = stage / "parts"
        parts.mkdir()
        entries: list[dict[str, Any]] = []
        for entry, part in work.takes(options, parts, []):
            worn, rate = tuple(entry.pop("labels")), float(entry.pop("rate_hz"))
            if not entries:
                options = replace(options, labels=worn, rate_hz=rate)
                _create(stage / "motions.npy", (len(options.labels), 3))
                _create(stage / "changes.npy", (len(NAMES),))
            _append(stage, part)
            entries.append(entry)
        if not entries:
            raise EvalkitError("no captures; name at least one to build a database from")
        shutil.rmtree(parts)
        manifest = _manifest(options, entries)
        for name, shape in (("motions.npy", (len(options.labels), 3)), ("changes.npy", (len(NAMES),))):
            _set_rows(stage / name, manifest["rows"], shape)
        _write_parameters(stage / "changes.npy", stage / manifest["parameters_file"], manifest)
        write_json(manifest, stage / MANIFEST)
    return open_database(output)


def add_takes(
    database: Database | str | Path,
    captures: Mapping[str, Source] | Iterable[Source],
    *,
    compensated: bool = False,
    rigid: str | Sequence[str] = "auto",
    performer: str = "",
    jobs: int = 1,
    scheduler: str | None = None,
    done: Callable[[str], object] | None = None,
) -> Database:
    """Add takes to a database; those that it has are not worked on again.

    The result is that of :func:`build_database` from all takes. A :class:`Database` that is open stays what it was.

    Parameters
    ----------
    database : Database or path
    captures, compensated, rigid, performer, jobs, scheduler, done
        As of :func:`build_database`; markers, rate and gaps are those of the database.

    Returns
    -------
    Database

    Raises
    ------
    EvalkitError
        As of :func:`build_database`, and if a take is in the database already or gives fewer control parameters. The
        database is then as before.
    """
    folder = database.folder if isinstance(database, Database) else Path(database)
    manifest = _read_manifest(folder)
    before = _opened(folder, manifest)
    check_output(folder)
    options = TakeOptions(before.labels, before.rate_hz, **manifest["options"])
    entries = [take.facts for take in before.takes]
    work = _Work(captures, compensated, rigid, performer, jobs, scheduler, done or (lambda name: None))
    _drop_after(folder, before)
    try:
        with staged(folder) as stage:
            parts = stage / "parts"
            parts.mkdir()
            new = []
            for entry, part in work.takes(options, parts, entries):
                del entry["labels"], entry["rate_hz"]
                lost = before.known & ~np.array([value is not None for value in entry["neutral"]])
                if lost.any():
                    name = NAMES[int(np.argmax(lost))]
                    raise EvalkitError(f"{entry['name']}: its markers do not give {name}, which the database has")
                _append(folder, part)
                new.append(entry)
            if not new:
                raise EvalkitError("no captures; name at least one to add")
            shutil.rmtree(parts)
            after = _manifest(options, [*entries, *new])
            for name, shape in (("motions.npy", (len(options.labels), 3)), ("changes.npy", (len(NAMES),))):
                _set_rows(folder / name, after["rows"], shape)
            _write_parameters(folder / "changes.npy", stage / after["parameters_file"], after)
            write_json(after, stage / MANIFEST)
    except BaseException:
        _drop_after(folder, before)
        raise
    # What was made for the database as it was: its normalised parameters, neighbour graphs.
    for old in folder.glob(f"*-{before.digest[:16]}.npy"):
        with contextlib.suppress(OSError):
            old.unlink()
    return open_database(folder)


@dataclass(frozen=True)
class _Work:
    """Captures that become takes, here or on a cluster."""

    captures: Mapping[str, Source] | Iterable[Source]
    compensated: bool
    rigid: str | Sequence[str]
    performer: str
    jobs: int
    scheduler: str | None
    done: Callable[[str], object]

    def takes(
        self, options: TakeOptions, parts: Path, before: Sequence[dict[str, Any]]
    ) -> Iterator[tuple[dict[str, Any], Path]]:
        """Entry of the manifest and stem of the files of every take, in their order.

        Raises
        ------
        EvalkitError
            If two takes have one name or the same rows.
        """
        row = before[-1]["rows"][1] if before else 0
        names = {entry["name"] for entry in before}
        contents = {entry["rows_sha256"]: entry["name"] for entry in before}
        for entry, part in self._prepared(options, parts, names):
            same = contents.setdefault(entry["rows_sha256"], entry["name"])
            if same != entry["name"]:
                raise EvalkitError(f"{entry['name']}: holds the same motion as the take '{same}'; name each take once")
            entry["rows"] = [row, row + entry.pop("count")]
            row = entry["rows"][1]
            self.done(entry["name"])
            yield entry, part

    def _prepared(self, options: TakeOptions, parts: Path, names: set[str]) -> Iterator[tuple[dict[str, Any], Path]]:
        if self.jobs == 0:
            raise EvalkitError("jobs = 0; use a number of processes, or -1 for one per core")
        sources = iter(_named(self.captures, names))
        first = next(sources, None)
        if first is None:
            return
        common = (self.compensated, self.rigid, self.performer)
        entry, _ = _stored_part((*first, parts / "0", options, *common))
        # The first take settles markers and rate for all others.
        settled = replace(options, labels=tuple(entry["labels"]), rate_hz=entry["rate_hz"])
        yield entry, parts / "0"
        calls = ((*source, parts / str(k + 1), settled, *common) for k, source in enumerate(sources))
        if self.scheduler:
            yield from _on_cluster(calls, self.scheduler)
        elif self.jobs == 1:
            yield from map(_stored_part, calls)
        else:
            yield from _in_processes(calls, self.jobs)


def _named(captures: Mapping[str, Source] | Iterable[Source], taken: set[str]) -> Iterator[tuple[Source, str]]:
    """Sources and their names, no name twice."""
    pairs = captures.items() if isinstance(captures, Mapping) else ((None, source) for source in captures)
    for k, (given, source) in enumerate(pairs):
        if isinstance(source, Capture):
            name = given or f"take {len(taken) + 1}"
        else:
            path = Path(source)
            name = given or (path.stem if path.stem not in taken else f"{path.parent.name}/{path.stem}")
        if name in taken:
            raise EvalkitError(f"{name}: the database has a take of this name (capture {k + 1}); rename one of them")
        taken.add(name)
        yield source, name


def _store(
    source: Source,
    name: str,
    part: Path,
    options: TakeOptions,
    compensated: bool,
    rigid: str | Sequence[str],
    performer: str,
) -> dict[str, Any]:
    """Prepare a take, write its rows beside `part`, and tell of it."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # sums run in the same order for any number of jobs, and digests are the same
        capture = source if isinstance(source, Capture) else read_capture(source)
        take = database_take(capture, name, options, compensated, rigid)
    take.motions.tofile(part.with_suffix(".motions"))
    take.changes.tofile(part.with_suffix(".changes"))
    file = None if isinstance(source, Capture) else Path(source)
    return _entry(take, performer, compensated) | {
        "source": file.name if file else None,
        "sha256": file_sha256(file) if file else hashlib.sha256(_bytes(capture.points)).hexdigest(),
    }


def _bytes(array: NDArray[Any]) -> memoryview:
    """What is hashed of an array, without a copy of it."""
    return np.ascontiguousarray(array).data


def _entry(take: DatabaseTake, performer: str, compensated: bool) -> dict[str, Any]:
    digest = hashlib.sha256(_bytes(take.motions))
    digest.update(_bytes(take.changes))
    digest.update(_bytes(take.segments.astype("<i8")))
    changes = take.changes.astype(np.float64)
    mean = changes.mean(axis=0)
    return {
        "name": take.name,
        "performer": performer,
        "compensated": compensated,
        "count": len(take.motions),
        "labels": list(take.labels),
        "rate_hz": take.rate_hz,
        "frames": take.frames,
        "own_rate_hz": take.own_rate_hz,
        "bridged": take.bridged,
        "rigid": list(take.rigid),
        "neutral": [value if math.isfinite(value) else None for value in take.neutral.tolist()],
        "rest_mm": take.rest_mm.tolist(),
        "mean": mean.tolist(),
        "m2": ((changes - mean) ** 2).sum(axis=0).tolist(),
        "segments": take.segments.tolist(),
        "rows_sha256": digest.hexdigest(),
        "warnings": take.warnings,
    }


def _in_processes(calls: Iterable[tuple[Any, ...]], jobs: int) -> Iterator[tuple[dict[str, Any], Path]]:
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    # No more takes are read ahead than are worked on, so that memory stays that of one take for each job.
    work = Parallel(n_jobs=jobs, return_as="generator", pre_dispatch="n_jobs", batch_size=1)
    try:
        yield from work(delayed(_stored_part)(call) for call in calls)
    except TerminatedWorkerError as error:
        raise EvalkitError("a worker process died, most likely for want of memory; use fewer --jobs") from error


def _stored_part(call: tuple[Any, ...]) -> tuple[dict[str, Any], Path]:
    return _store(*call), call[2]


def _on_cluster(calls: Iterable[tuple[Any, ...]], address: str) -> Iterator[tuple[dict[str, Any], Path]]:
    """The same on the workers of a dask cluster, which write into the folder of this machine."""
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise EvalkitError("running on a cluster needs dask: pip install 'evalkit[cluster]'") from error
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise EvalkitError(f"{address}: no dask scheduler answers there; start one with 'dask scheduler'") from error
    try:
        if not client.scheduler_info()["workers"]:
            raise EvalkitError(f"{address}: the scheduler has no workers; start one with 'dask worker {address}'")
        # Absolute paths: workers have working folders of their own.
        absolute = [tuple(v.absolute() if isinstance(v, Path) else v for v in call) for call in calls]
        futures = [client.submit(_stored_part, call, pure=False, retries=0) for call in absolute]
        for future in futures:
            try:
                entry, part = future.result()
            except KilledWorker as error:
                raise EvalkitError(f"{address}: a worker died, most likely for want of memory") from error
            if not part.with_suffix(".motions").is_file():
                raise EvalkitError(f"{address}: its workers do not write to {part.parent}; use a shared folder")
            yield entry, part
            future.release()
    finally:
        client.close()


def _check(options: TakeOptions) -> None:
    for name in ("rate_hz", "gap_s", "shortest_s", "neutral_s"):
        value = getattr(options, name)
        if not (math.isfinite(value) and value >= 0):
            raise EvalkitError(f"{name} = {value}; it must be a number >= 0")


def _manifest(options: TakeOptions, entries: list[dict[str, Any]]) -> dict[str, Any]:
    """Description of a database of these takes; its digest is that of what it holds and how it was made."""
    known = np.asarray(np.all([[value is not None for value in entry["neutral"]] for entry in entries], axis=0))
    settings = {name: value for name, value in asdict(options).items() if name not in ("labels", "rate_hz")}
    content = {
        "version": VERSION,
        "labels": list(options.labels),
        "rate_hz": options.rate_hz,
        "options": settings,
        "takes": [[entry["name"], entry["performer"], entry["rows_sha256"]] for entry in entries],
    }
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return {
        "format": FORMAT,
        "version": VERSION,
        "evalkit": __version__,
        "digest": digest,
        "labels": list(options.labels),
        "rate_hz": options.rate_hz,
        "options": settings,
        "parameters": list(NAMES),
        "known": known.tolist(),
        "spread": _spread(entries, known).tolist(),
        "parameters_file": f"parameters-{digest[:16]}.npy",
        "rows": entries[-1]["rows"][1],
        "takes": entries,
    }


def _spread(entries: Sequence[dict[str, Any]], known: NDArray[np.bool_]) -> Array:
    """Standard deviation over the rows of all takes from their counts, means and sums of squares about them.

    Chan, Golub & LeVeque, "Algorithms for computing the sample variance" (1983), doi:10.1080/00031305.1983.10483115.
    """
    count = np.array([entry["rows"][1] - entry["rows"][0] for entry in entries], dtype=np.float64)[:, None]
    means = np.array([entry["mean"] for entry in entries])
    mean = (count * means).sum(axis=0) / count.sum()
    squares = np.array([entry["m2"] for entry in entries]).sum(axis=0) + (count * (means - mean) ** 2).sum(axis=0)
    return np.where(known, np.maximum(np.sqrt(squares / count.sum()), STILL), 1.0)


def _create(path: Path, shape: tuple[int, ...]) -> None:
    with path.open("wb") as file:
        _write_header(file, 0, shape)


def _write_header(file: Any, rows: int, shape: tuple[int, ...]) -> None:
    # NumPy leaves room in the header for the first axis to grow; its length is the same for any number of rows.
    facts = {"descr": "<f4", "fortran_order": False, "shape": (rows, *shape)}
    np.lib.format.write_array_header_1_0(file, facts)


def _set_rows(path: Path, rows: int, shape: tuple[int, ...]) -> None:
    with path.open("r+b") as file:
        _write_header(file, rows, shape)


def _append(folder: Path, part: Path) -> None:
    """Rows of a take to the end of the files; its own go."""
    for kind in ("motions", "changes"):
        own = part.with_suffix(f".{kind}")
        with own.open("rb") as source, (folder / f"{kind}.npy").open("ab") as target:
            shutil.copyfileobj(source, target, 1 << 20)
        own.unlink()


def _drop_after(folder: Path, database: Database) -> None:
    """Cut off what an addition that failed, or was killed, has left behind the rows of a database."""
    for name, shape in (("motions.npy", (len(database.labels), 3)), ("changes.npy", (len(NAMES),))):
        _set_rows(folder / name, database.rows, shape)
        with (folder / name).open("r+b") as file:
            np.lib.format.read_magic(file)
            np.lib.format.read_array_header_1_0(file)
            os.truncate(folder / name, file.tell() + 4 * database.rows * math.prod(shape))


def _write_parameters(changes: Path, path: Path, manifest: dict[str, Any]) -> None:
    """Changes over the spread, block by block."""
    source = np.load(changes, mmap_mode="r")
    scale = np.where(manifest["known"], 1.0 / np.array(manifest["spread"]), 0.0)
    target = np.lib.format.open_memmap(path, mode="w+", dtype=np.float32, shape=source.shape)
    for rows in blocks(len(source), 1 << 17):
        target[rows] = source[rows] * scale
    target.flush()
