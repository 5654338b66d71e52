"""What can go wrong with a user's data, and the statuses of data that cannot answer.

A mistake that stops the work is an :class:`EvalkitError`: one line that names the file, label, frame or
index and says what to do; the command line prints that line and exits with 1. Data that merely cannot
answer for some frames or some direction is not an error: it gets a status.
"""

from __future__ import annotations

from enum import IntEnum


class EvalkitError(Exception):
    """Root of every error that a user can cause. Its text is one line.

    Examples
    --------
    >>> import evalkit
    >>> evalkit.load_head("nobody")
    Traceback (most recent call last):
    evalkit.errors.EvalkitError: nobody: no such file or folder
    """


class CaptureError(EvalkitError):
    """A capture file that cannot be read or written as it stands.

    Examples
    --------
    >>> import evalkit
    >>> evalkit.read_capture("nowhere.c3d")
    Traceback (most recent call last):
    evalkit.errors.CaptureError: nowhere.c3d: no such file; check the path
    """


class FrameStatus(IntEnum):
    """Whether the head pose of one frame is known, and if not, why.

    Examples
    --------
    >>> from evalkit import FrameStatus
    >>> [status.text for status in FrameStatus]
    ['ok', 'too-few-markers', 'collinear', 'not-converged']
    """

    OK = 0
    TOO_FEW_MARKERS = 1
    COLLINEAR = 2
    NOT_CONVERGED = 3

    @property
    def text(self) -> str:
        """The status as it is written in tables: lower case with hyphens."""
        return self.name.lower().replace("_", "-")
