"""Entries of evalkit's tables that other installed packages bring along, found through Python entry points.

A package that declares, say, ``[project.entry-points."evalkit.pose"]`` with ``mine = "my_package:estimator"`` adds
the entry ``mine`` to the table of pose estimators as soon as it is installed. ``tests/plugin_example/`` is one to copy.
The groups are ``evalkit.pose``, ``evalkit.pivot``, ``evalkit.kernels`` and ``evalkit.presets``.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from evalkit.errors import EvalkitError

Entry = TypeVar("Entry")


class PluginWarning(UserWarning):
    """An entry of another package that was left out, and why."""


class Table(Mapping[str, Entry]):
    """evalkit's own entries and, after them, those of installed plugins; read it like a dict.

    Plugins are loaded at the first look into the table, not when the module that holds it is imported: a plugin
    imports that very module, and could not be loaded halfway through the import of either.

    Parameters
    ----------
    own : mapping of str to Entry
        Entries of evalkit; a plugin cannot replace them.
    group : str
        Entry point group.
    kind : type
        What an entry must be.
    """

    def __init__(self, own: Mapping[str, Entry], group: str, kind: type[Entry]) -> None:
        self._entries = dict(own)
        self._kind = kind
        self._waiting: str | None = group
        self._added: set[str] = set()

    def _loaded(self) -> dict[str, Entry]:
        if self._waiting is not None:
            # Cleared first: a plugin may look into the table while it is being loaded.
            group, self._waiting = self._waiting, None
            self._entries.update(plugins(group, self._kind, taken=self._entries))
        return self._entries

    def add(self, name: str, entry: Entry) -> None:
        """Add an entry for as long as this Python runs: to try a method before it is packaged.

        The same name may be added again, as when a cell of a notebook is run twice. Other processes do not know it:
        run studies with ``jobs=1``.

        Raises
        ------
        EvalkitError
            If the name is taken, or the entry is of another type.
        """
        if name in self._loaded() and name not in self._added:
            raise EvalkitError(f"the name '{name}' is taken; choose another one")
        if not isinstance(entry, self._kind):
            raise EvalkitError(f"'{name}' is of type {type(entry).__name__}; this table takes {self._kind.__name__}")
        self._entries[name] = entry
        self._added.add(name)

    def __getitem__(self, name: str) -> Entry:
        return self._loaded()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._loaded())

    def __len__(self) -> int:
        return len(self._loaded())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._loaded()!r})"


def plugins(group: str, kind: type[Entry], taken: Collection[str]) -> dict[str, Entry]:
    """Load the entries that other packages offer for one table.

    Parameters
    ----------
    group : str
        Entry point group, such as ``evalkit.pose``.
    kind : type
        What an entry must be an instance of.
    taken : collection of str
        Names that are in the table already.

    Returns
    -------
    dict of str to kind
        By name, in the order of distribution and name. Where ``kind`` is a dataclass with a field ``origin = ""``, it
        gets the name and version of the distribution.

    Warns
    -----
    PluginWarning
        One line for each entry that does not load, is of another type or has a name that is taken; it is left out.
    """
    found: dict[str, Entry] = {}
    for point in sorted(entry_points(group=group), key=lambda point: (_distribution(point), point.name)):
        try:
            entry = _load(point, kind, {*taken, *found})
        except (Exception, SystemExit) as error:  # whatever a stranger's module does when it is imported
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            text = f"{_distribution(point)}: {group} entry '{point.name}' ({point.value}) is left out: {reason}"
            # Not where this file stands, but who is to blame: and no line of source after the message.
            warnings.warn_explicit(text, PluginWarning, filename=_distribution(point), lineno=0)
        else:
            found[point.name] = entry
    return found


def _load(point: EntryPoint, kind: type[Entry], taken: Collection[str]) -> Entry:
    if point.name in taken:
        raise ValueError("the name is taken")
    entry: Any = point.load()
    if not isinstance(entry, kind):
        raise TypeError(f"it is of type {type(entry).__name__}, not {kind.__module__}.{kind.__name__}")
    named: Any = entry
    return replace(named, origin=_distribution(point)) if hasattr(kind, "origin") else entry


def _distribution(point: EntryPoint) -> str:
    """Name and version of the distribution that declares an entry point."""
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "unknown distribution"
