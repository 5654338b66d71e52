"""The built-in head at a low resolution, made once for all tests of a process."""

from __future__ import annotations

import functools

import pytest

from evalkit.errors import EvalkitError
from evalkit.head import Head, load_head
from evalkit.render import require_offscreen


@functools.cache
def small_head() -> Head:
    """About 1,400 vertices."""
    return load_head(vertices=1000)


def head_to_draw() -> Head:
    """The same; the test is skipped where nothing can be drawn."""
    try:
        require_offscreen()
    except EvalkitError as error:
        pytest.skip(str(error))
    return small_head()
