"""What every peer needs: whether it is installed, which version, and its words when it fails."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from evalkit.errors import EvalkitError


def installed(module: str, distribution: str) -> str:
    """Name and version of a distribution whose module can be imported, empty if it cannot; nothing is imported."""
    if find_spec(module) is None:
        return ""
    try:
        return f"{distribution} {version(distribution)}"
    except PackageNotFoundError:
        return ""  # a folder of that name, not the package


@contextmanager
def words_of(peer: str) -> Iterator[None]:
    """Turn whatever a peer raises into an EvalkitError of one line with its name and its words."""
    try:
        yield
    except EvalkitError:
        raise
    except Exception as error:  # a peer may raise anything
        raise EvalkitError(f"{peer} failed: " + " ".join(f"{type(error).__name__}: {error}".split())) from error
