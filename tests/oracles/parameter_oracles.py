"""The control parameters of one frame by plain trigonometry on named points; nothing shared with evalkit."""

from __future__ import annotations

import math


def distance(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)


def middle(*points):
    return sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)


def slope_deg(a, b):
    return math.degrees(math.atan2(b[1] - a[1], b[0] - a[0]))


def frame_parameters(points, unit):
    """Name -> value; ``points`` maps names to (x, y), x to the person's left, y up."""
    corners = {s: middle(points[f"eye inner {s}"], points[f"eye outer {s}"]) for s in ("left", "right")}
    upper, lower = points["upper lip"], points["lower lip"]
    left, right = points["mouth corner left"], points["mouth corner right"]
    mouth, eyes = middle(upper, lower, left, right), middle(corners["left"], corners["right"])
    opening = distance(upper, lower) / unit
    wings = points["nose wing left"], points["nose wing right"]
    out = {
        "lip_opening": opening,
        "lip_width": distance(left, right) / unit,
        "mouth_x": (mouth[0] - eyes[0]) / unit,
        "mouth_y": (mouth[1] - eyes[1]) / unit,
        "lip_angle": math.degrees(math.atan2(upper[0] - lower[0], upper[1] - lower[1])) * min(1.0, opening / 0.1),
        "mouth_angle": slope_deg(right, left),
        "nose_width": distance(*wings) / unit,
        "nose_tip": distance(points["nose tip"], middle(*wings)) / unit,
        "brow_distance": distance(points["brow inner left"], points["brow inner right"]) / unit,
    }
    for side, mirror in (("left", 1), ("right", -1)):
        inner, outer = points[f"brow inner {side}"], points[f"brow outer {side}"]
        out[f"eye_{side}"] = distance(points[f"upper lid {side}"], points[f"lower lid {side}"]) / unit
        out[f"brow_angle_{side}"] = slope_deg((mirror * inner[0], inner[1]), (mirror * outer[0], outer[1]))
        out[f"brow_height_{side}"] = (middle(inner, outer)[1] - corners[side][1]) / unit
    return out
