"""The built-in head as it was made before: it follows from nothing but its code, and takes seconds to make."""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.head.makehuman import cache_folder
from evalkit.head.model import Head, read_head

MOST_KEPT = 12
"""Files of this kind in the cache, the newest; a few megabytes each."""


def kept_template(vertices: int | None = None) -> Head:
    """The template out of the user's cache, to the last bit as :func:`evalkit.head.template.make_template` makes it.

    What is not there, or cannot be read, is made, and kept where the cache can be written.

    Parameters
    ----------
    vertices : int, optional
        About how many; as many as the template has by default.

    Returns
    -------
    Head

    Raises
    ------
    EvalkitError
        If the number is out of range.
    """
    path = cache_folder() / f"template-{vertices or 'default'}-{_digest()}.npz"
    with contextlib.suppress(EvalkitError):
        return read_head(path)
    # Loaded only now: what a kept head is read with is little.
    from evalkit.head.template import DEFAULT_VERTICES, make_template

    head = make_template(vertices or DEFAULT_VERTICES)
    with contextlib.suppress(EvalkitError, OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        # Processes that make the same head at once each write a file of their own.
        own = path.with_name(f".{os.getpid()}-{path.name}")
        head.save(own)
        own.replace(path)
        for old in sorted(path.parent.glob("template-*.npz"), key=lambda file: file.stat().st_mtime)[:-MOST_KEPT]:
            old.unlink(missing_ok=True)
    return head


def _digest() -> str:
    """Of all that a template follows from: the code of heads, and NumPy."""
    import scipy

    here = Path(__file__).parent
    digest = hashlib.sha256(f"{np.__version__} {scipy.__version__}".encode())
    for path in [*sorted(here.glob("*.py")), here.parent / "geometry.py", here.parent / "seeds.py"]:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
