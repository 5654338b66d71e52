"""Cells that are done, line by line in a file, so that an interrupted study goes on where it stopped."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from evalkit.errors import EvalkitError
from evalkit.study.cell import Rows

Done = tuple[Rows, Rows]


class Journal:
    """The finished cells of one study in one folder.

    The first line names the code, packages and data that the cells come from; cells of another state are not mixed
    in: the old journal is put aside as ``*.previous`` and a new one begun. A line cut off by a crash is ignored.

    Parameters
    ----------
    path : Path
    fingerprint : str
        See :func:`evalkit.study.provenance.fingerprint`.
    fresh : bool
        Put aside what is there in any case.

    Raises
    ------
    EvalkitError
        If the file cannot be read or written.
    """

    def __init__(self, path: Path, fingerprint: str, fresh: bool = False) -> None:
        self.path = path
        self.done: dict[str, Done] = {}
        self.put_aside = False
        try:
            text = path.read_text(encoding="utf-8") if path.exists() else ""
            lines = text.split("\n")
            whole, cut = lines[:-1], lines[-1]  # a finished line ends with a newline
            head = _parsed(whole[0]) if whole else None
            if text and (fresh or not head or head.get("fingerprint") != fingerprint):
                path.replace(path.with_name(path.name + ".previous"))
                self.put_aside, text = True, ""
            if text:
                for line in whole[1:]:
                    entry = _parsed(line)
                    if entry and {"cell", "rows", "machine"} <= entry.keys():
                        self.done[entry["cell"]] = (entry["rows"], entry["machine"])
            self._file = path.open("a", encoding="utf-8")
            if not text:
                self._write({"fingerprint": fingerprint})
            elif cut:
                self._file.write("\n")  # the next line must not grow onto the cut one
        except OSError as error:
            raise EvalkitError(f"{path}: cannot be written ({error.strerror}); choose another output folder") from error
        except UnicodeDecodeError as error:
            raise EvalkitError(f"{path}: is not a journal of a study; delete it or choose another folder") from error

    def add(self, key: str, done: Done) -> None:
        """Record a finished cell; it is on its way to the disk when this returns."""
        self.done[key] = done
        self._write({"cell": key, "rows": done[0], "machine": done[1]})

    def _write(self, entry: dict[str, Any]) -> None:
        self._file.write(json.dumps(entry) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Make sure that everything is on the disk."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()


def _parsed(line: str) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except json.JSONDecodeError:
        return None
    return entry if isinstance(entry, dict) else None
