"""Slow, obvious versions of what a search for windows does: one window at a time, in plain Python."""

from __future__ import annotations

import math


def windows_slow(segments, window):
    """First rows of all windows that stay within a segment."""
    found = []
    for start, stop in segments:
        for row in range(start, stop):
            if row + window <= stop:
                found.append(row)
    return sorted(found)


def nearest_slow(parameters, segments, window, query, k):
    """Pairs (distance, first row) of the k nearest windows, nearest first, the earlier one of equal ones."""
    width = len(parameters[0])
    found = []
    for row in windows_slow(segments, window):
        total = 0.0
        for frame in range(window):
            for column in range(width):
                total += (float(parameters[row + frame][column]) - float(query[frame * width + column])) ** 2
        found.append((math.sqrt(total), row))
    return sorted(found)[:k]
