"""One take as it was observed."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.errors import CaptureError

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
"""Millimetres in one unit of length, for the units that a capture file may state."""

QUANTITIES = ("position", "angle", "force", "moment", "power", "scalar")
"""What a point of a capture may measure."""


@dataclass(frozen=True, eq=False)
class Capture:
    """A marker capture: positions over time, in millimetres, NaN where a marker was occluded.

    Parameters
    ----------
    points : array_like, shape (F, M, 3)
        Marker positions in world axes, mm. A marker with any non-finite coordinate is occluded in that
        frame: all three become NaN.
    labels : sequence of str, length M
        Marker names, unique.
    rate : float
        Frames per second, Hz.
    unit : {"mm", "cm", "m", "in"}
        Unit of length of the file that the take came from; it is written back in this unit.
    first_frame : int
        Number of the first frame in the source, counted from 1.
    axes : (str, str) or None
        The world axes that point right and up on the operator's screen, such as ``("+X", "+Z")``
        (POINT:X_SCREEN and Y_SCREEN of a C3D file), or None where the file does not say.
    quantities : sequence of str, length M, optional
        What each point measures: ``"position"`` (default) or, in files that store model outputs among
        the points, ``"angle"``, ``"force"``, ``"moment"``, ``"power"``, ``"scalar"``. Only positions are
        in millimetres; the others keep the file's numbers.
    warnings : sequence of str
        What the reader noticed, in words.
    source : object, optional
        What a reader keeps so that a processed copy can preserve the rest of the file.

    Raises
    ------
    CaptureError
        If shapes, labels, rate or unit are not as above.

    Examples
    --------
    Two frames of two markers, the second marker occluded in the second frame:

    >>> import evalkit
    >>> gone = [float("nan")] * 3
    >>> take = evalkit.Capture([[[0, 0, 0], [0, -40, 5]], [[1, 0, 0], gone]], labels=["Nose", "Chin"], rate=50)
    >>> take.frames, take.unit, take.indices(["Chin"])
    (2, 'mm', [1])
    >>> take.times
    array([0.  , 0.02])
    >>> take.visible
    array([[ True,  True],
           [ True, False]])
    """

    points: NDArray[np.float64]
    labels: list[str]
    rate: float
    unit: str = "mm"
    first_frame: int = 1
    axes: tuple[str, str] | None = None
    quantities: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    source: Any = field(default=None, repr=False)

    def __init__(
        self,
        points: ArrayLike,
        labels: Sequence[str],
        rate: float,
        unit: str = "mm",
        first_frame: int = 1,
        axes: tuple[str, str] | None = None,
        quantities: Sequence[str] = (),
        warnings: Sequence[str] = (),
        source: Any = None,
    ) -> None:
        try:
            array = np.array(points, dtype=np.float64, order="C")
        except (TypeError, ValueError):
            raise CaptureError("points are no array of numbers; expected shape (frames, markers, 3)") from None
        if array.ndim != 3 or array.shape[2] != 3:
            raise CaptureError(f"points have shape {array.shape}; expected (frames, markers, 3)")
        seen = np.isfinite(array[:, :, 0])
        seen &= np.isfinite(array[:, :, 1])
        seen &= np.isfinite(array[:, :, 2])
        if not seen.all():
            array[~seen] = np.nan
        self._fill(array, labels, rate, unit, first_frame, axes, quantities, warnings, source)

    @classmethod
    def _adopt(cls, points: NDArray[np.float64], **rest: Any) -> Capture:
        """A take that owns `points` instead of a copy; for readers, which mark occlusions themselves."""
        take = cls.__new__(cls)
        defaults = {"first_frame": 1, "axes": None, "quantities": (), "warnings": (), "source": None}
        take._fill(points, **(defaults | rest))
        return take

    def _fill(
        self,
        array: NDArray[np.float64],
        labels: Sequence[str],
        rate: float,
        unit: str,
        first_frame: int,
        axes: tuple[str, str] | None,
        quantities: Sequence[str],
        warnings: Sequence[str],
        source: Any,
    ) -> None:
        names = [str(label) for label in labels]
        if len(names) != array.shape[1]:
            raise CaptureError(f"{len(names)} labels for {array.shape[1]} markers; give one label a marker")
        if len(set(names)) != len(names):
            twice = next(name for k, name in enumerate(names) if name in names[:k])
            raise CaptureError(f"label '{twice}' is given twice; rename one of the markers")
        if not (np.isfinite(rate) and rate > 0):
            raise CaptureError(f"frame rate {rate!r} is not a positive number of frames per second")
        if unit not in MILLIMETRES:
            raise CaptureError(f"unit '{unit}' is not a known unit of length; use one of {', '.join(MILLIMETRES)}")
        kinds = list(quantities) or ["position"] * len(names)
        if len(kinds) != len(names):
            raise CaptureError(f"{len(kinds)} quantities for {len(names)} markers; give one a marker")
        unknown = next((kind for kind in kinds if kind not in QUANTITIES), None)
        if unknown is not None:
            raise CaptureError(f"quantity '{unknown}' is not known; use one of {', '.join(QUANTITIES)}")
        for name, value in (
            ("points", array), ("labels", names), ("rate", float(rate)), ("unit", unit),
            ("first_frame", int(first_frame)), ("axes", axes), ("quantities", kinds),
            ("warnings", list(warnings)), ("source", source),
        ):  # fmt: skip
            object.__setattr__(self, name, value)

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return int(self.points.shape[0])

    @property
    def times(self) -> NDArray[np.float64]:
        """Time of every frame from the first, s, shape (F,)."""
        return np.arange(self.frames) / self.rate

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Where a marker was seen, shape (F, M)."""
        return ~np.isnan(self.points[:, :, 0])

    def indices(self, labels: Sequence[str]) -> list[int]:
        """Columns of the named markers.

        Raises
        ------
        CaptureError
            If a label is not in the capture; the nearest existing labels are suggested.
        """
        columns = {label: k for k, label in enumerate(self.labels)}
        found = []
        for label in labels:
            if label not in columns:
                lower = {name.lower(): name for name in self.labels}
                near = [lower[n] for n in difflib.get_close_matches(label.lower(), lower, n=3, cutoff=0.5)]
                hint = (
                    f"; did you mean {' or '.join(near)}?"
                    if near
                    else f"; it has {', '.join(self.labels[:12])}" + (" ..." if len(self.labels) > 12 else "")
                )
                raise CaptureError(f"marker '{label}' is not in the capture{hint}")
            found.append(columns[label])
        return found

    def with_points(self, points: ArrayLike, *, copy: bool = True) -> Capture:
        """The same take with other positions (a processed copy), everything else kept.

        Without ``copy`` the array itself is kept: for positions made for this take and nothing else, whose occluded
        markers are NaN in all three coordinates.
        """
        array = np.asarray(points, dtype=np.float64)
        if array.shape != self.points.shape:
            raise CaptureError(f"points have shape {array.shape}; the capture has {self.points.shape}")
        if copy:
            return replace(self, points=array)
        kept = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "points"}
        return Capture._adopt(array, **kept)
