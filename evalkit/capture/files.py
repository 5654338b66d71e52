"""Opening captures for reading and writing so that every failure is one line and no half file is left."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from evalkit.errors import CaptureError


@dataclass(frozen=True)
class FileSource:
    """Which file a take was read from, so that it is never overwritten by its own processed copy."""

    path: Path


def shown(path: str | os.PathLike[str]) -> str:
    """The path as it may stand in a one-line message, whatever its characters."""
    text = str(path).encode("utf-8", "replace").decode()
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def reason(error: OSError) -> str:
    """Why the operating system refused, in its own words."""
    return (error.strerror or type(error).__name__).lower()


def size_of_regular_file(path: Path) -> int:
    """Size of a capture file, bytes.

    Raises
    ------
    CaptureError
        If it does not exist, is no regular file (reading a pipe or a device need never end) or is empty.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        raise CaptureError(f"{shown(path)}: no such file; check the path") from None
    except OSError as error:
        raise CaptureError(f"{shown(path)}: cannot be opened ({reason(error)})") from None
    except ValueError:
        raise CaptureError(f"{shown(path)}: not a valid file name; check the path") from None
    if stat.S_ISDIR(status.st_mode):
        raise CaptureError(f"{shown(path)}: a directory, not a capture; name a file in it")
    if not stat.S_ISREG(status.st_mode):
        raise CaptureError(f"{shown(path)}: not a regular file; copy the capture to a file first")
    if status.st_size == 0:
        raise CaptureError(f"{shown(path)}: empty (0 bytes); get a complete copy of the file")
    return int(status.st_size)


def read_bytes(path: Path) -> bytes:
    """The whole file; any refusal of the operating system becomes a CaptureError."""
    size_of_regular_file(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise CaptureError(f"{shown(path)}: cannot be read ({reason(error)})") from None
    except MemoryError:
        raise CaptureError(f"{shown(path)}: does not fit into memory; cut the take into parts") from None


def refuse_own_source(path: Path, source: object) -> None:
    """Raise CaptureError if `path` is the file that the take was read from."""
    origin = getattr(source, "path", None)
    if origin is None:
        return
    with suppress(OSError, ValueError):
        if path.samefile(origin):
            raise CaptureError(
                f"{shown(path)}: is the file that the take was read from and is never overwritten; "
                "write to another name"
            )


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Write a file whole or not at all: under a temporary name in the same folder, then renamed.

    Raises
    ------
    CaptureError
        If the folder is missing or not writable, the name is a directory, or the disk is full. Whatever
        is raised inside, nothing is left behind.
    """
    temporary = path.with_name(f".{path.name[:64]}.{secrets.token_hex(6)}.tmp")
    try:
        if path.is_dir():
            raise CaptureError(f"{shown(path)}: a directory; name a file in it")
        if not path.parent.is_dir():
            raise CaptureError(f"{shown(path)}: the folder {shown(path.parent)} does not exist; make it first")
        try:
            # Exclusive creation with the default mode: unlike tempfile's 0600 it honours the user's umask.
            with temporary.open("xb") as stream:
                yield stream
            temporary.replace(path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise
    except OSError as error:
        raise CaptureError(f"{shown(path)}: cannot be written ({reason(error)})") from None
    except ValueError as error:
        if "null" not in str(error):
            raise
        raise CaptureError(f"{shown(path)}: not a valid file name; check the path") from None
