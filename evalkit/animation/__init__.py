"""A take played on a head: marker labels, rest, gaps, lids, jaw, head motion, and the moving mesh as glTF."""

from evalkit.animation.performance import Animation, animate

__all__ = ["Animation", "animate"]
