"""Marker labels between files and takes."""

from __future__ import annotations

from collections.abc import Sequence

from evalkit.errors import CaptureError

MOST_TOLD = 10
"""Labels whose change is told one by one."""


def printable(text: str, length: int = 60) -> str:
    """Text from a file, fit for a one-line message."""
    return "".join(letter if letter.isprintable() else "?" for letter in text[:length])


def unique_labels(labels: Sequence[str], warnings: list[str]) -> list[str]:
    """Labels made printable, non-blank and unique; every change is told in `warnings`."""
    unique: dict[str, None] = {}
    changed = []
    taken = set(labels)
    count: dict[str, int] = {}
    for k, original in enumerate(labels):
        base = "".join(letter if letter.isprintable() else "_" for letter in original) or f"unnamed_{k + 1}"
        label = base
        while label in unique or (label != original and label in taken):
            count[base] = count.get(base, 1) + 1
            label = f"{base}_{count[base]}"
        if label != original:
            changed.append(f"label '{printable(original)}' of point {k + 1} is read as '{label}'")
        unique[label] = None
    warnings += changed[:MOST_TOLD]
    if len(changed) > MOST_TOLD:
        warnings.append(f"{len(changed) - MOST_TOLD} more labels are read otherwise than they stand there")
    return list(unique)


def check_labels(labels: Sequence[str]) -> None:
    """Raise CaptureError for a label that a file cannot hold so that it reads back the same."""
    for k, label in enumerate(labels):
        if not label or label != label.strip() or not label.isprintable():
            raise CaptureError(
                f"label {label[:60]!a} of marker {k + 1} is blank, padded or has control characters; rename the marker"
            )
