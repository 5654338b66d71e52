"""What a study is: a frozen description of its axes, methods, seeds, columns and statistics."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

from evalkit.errors import EvalkitError
from evalkit.study.statistics import Statistic

Scalar = str | int | float | bool
Condition = Mapping[str, Scalar]

KEYS = ("method", "seed", "status", "message")
"""Columns that every study has, besides its axes."""


@dataclass(frozen=True)
class Budget:
    """How much of a study is done.

    Attributes
    ----------
    seeds : int
        Takes per condition, seeds 0 to seeds - 1.
    axes : mapping
        Axes that keep fewer values, name to values; the others keep all.
    methods : tuple of str
        Methods that are kept; empty keeps all.
    """

    seeds: int
    axes: Mapping[str, tuple[Scalar, ...]] = field(default_factory=dict)
    methods: tuple[str, ...] = ()


@dataclass(frozen=True)
class Expected:
    """A limit that a statistic of the summary is expected to keep.

    Attributes
    ----------
    statistic, method : str
    limit : float
    least : bool
        Whether the limit is a lower one.
    where : mapping
        Values of axes for which it holds; axes that are not named may have any.
    """

    statistic: str
    method: str
    limit: float
    least: bool = False
    where: Condition = field(default_factory=dict)


def product(axes: Mapping[str, tuple[Scalar, ...]]) -> list[dict[str, Scalar]]:
    """Every combination of the axes' values, the last axis fastest."""
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]


@dataclass(frozen=True)
class Study:
    """One question, and everything that its answer depends on.

    A cell is one condition and one seed. Its data is prepared once; every method then runs on the same data, so
    that methods are compared in pairs. Only ``run`` is timed; ``score`` sees the truth, the method does not.

    Attributes
    ----------
    name : str
    question, finding : str
        What is asked, and what came out, in words; numbers in the finding are those of the full budget.
    axes : mapping
        Axis to its values: numbers or texts, the names of the cells.
    methods : tuple of str
    prepare : callable
        ``prepare(seed=..., **condition) -> data``; must depend on nothing else.
    run : callable
        ``run(data, method) -> result``.
    score : callable
        ``score(data, result) -> {column: number or text}``.
    columns : mapping
        Column to what it is, with its formula and unit; exactly those that ``score`` gives.
    statistics : tuple of Statistic
        Summaries over the seeds.
    full, small : Budget
    machine : mapping
        Columns of ``score`` that depend on the machine and the moment, such as memory: kept in a table of their
        own, beside ``seconds``, so that the table of results is the same in every run.
    conditions : callable
        From axes to conditions; all combinations by default.
    applies : callable
        ``applies(condition, method) -> bool``: which methods make sense where.
    expected : tuple of Expected
    serial : bool
        Cells run one at a time, because what is measured is time or memory.
    """

    name: str
    question: str
    finding: str
    axes: Mapping[str, tuple[Scalar, ...]]
    methods: tuple[str, ...]
    prepare: Callable[..., Any]
    run: Callable[[Any, str], Any]
    score: Callable[[Any, Any], Mapping[str, Any]]
    columns: Mapping[str, str]
    statistics: tuple[Statistic, ...]
    full: Budget
    small: Budget
    machine: Mapping[str, str] = field(default_factory=dict)
    conditions: Callable[[Mapping[str, tuple[Scalar, ...]]], Iterable[Condition]] = product
    applies: Callable[[Condition, str], bool] | None = None
    expected: tuple[Expected, ...] = ()
    serial: bool = False

    def __post_init__(self) -> None:
        clash = [name for name in (*self.axes, *self.columns, *self.machine) if name in (*KEYS, "seconds")]
        clash += [name for name in self.axes if name in self.columns or name in self.machine]
        if clash:
            raise EvalkitError(f"study {self.name}: '{clash[0]}' names two columns")
        for axis, values in self.axes.items():
            for value in values:
                if not isinstance(value, (str, Real)) or (isinstance(value, float) and not math.isfinite(value)):
                    raise EvalkitError(f"study {self.name}: {axis} = {value!r} is neither a number nor a text")
        known = {*self.columns, *self.machine, "seconds"}
        for statistic in self.statistics:
            for column in statistic.columns:
                if column not in known:
                    raise EvalkitError(f"study {self.name}: statistic '{statistic.name}' needs the column '{column}'")

    def at(self, budget: str | Budget) -> Study:
        """The study as a budget cuts it: ``small``, ``full`` or a Budget.

        Raises
        ------
        EvalkitError
            If the budget is not known, or names an axis or a method that the study does not have.
        """
        if isinstance(budget, str):
            if budget not in ("small", "full"):
                raise EvalkitError(f"budget '{budget}' is not known; use small or full")
            budget = self.small if budget == "small" else self.full
        if isinstance(budget.seeds, bool) or not isinstance(budget.seeds, int) or budget.seeds < 1:
            raise EvalkitError(f"study {self.name}: {budget.seeds!r} seeds; at least one is needed")
        for axis in budget.axes:
            if axis not in self.axes:
                raise EvalkitError(f"study {self.name} has no axis '{axis}'; its axes are {', '.join(self.axes)}")
        for method in budget.methods:
            if method not in self.methods:
                raise EvalkitError(f"study {self.name} has no method '{method}'; it has {', '.join(self.methods)}")
        methods = tuple(m for m in self.methods if m in budget.methods) if budget.methods else self.methods
        return replace(self, axes={**self.axes, **budget.axes}, methods=methods, full=budget)

    def cells(self) -> list[Cell]:
        """Every condition and seed of the full budget, in the order of the table."""
        found = [
            Cell(self.name, tuple(condition.items()), seed)
            for condition in self.conditions(self.axes)
            for seed in range(self.full.seeds)
        ]
        if not found:
            raise EvalkitError(f"study {self.name}: no condition to measure; {self.question}")
        return found

    def methods_of(self, condition: Condition) -> Sequence[str]:
        """Methods that make sense in a condition."""
        return [m for m in self.methods if self.applies is None or self.applies(condition, m)]


@dataclass(frozen=True)
class Cell:
    """One condition of a study, axis and value, and one seed."""

    study: str
    condition: tuple[tuple[str, Scalar], ...]
    seed: int

    @property
    def key(self) -> str:
        """The cell's own name, from which everything random in it follows."""
        return "|".join([self.study, *(f"{axis}={value!r}" for axis, value in self.condition), f"seed={self.seed}"])
