"""Pictures by VTK without a screen. VTK is loaded by the first picture, not by importing this package."""

from evalkit.render.markers import head_columns
from evalkit.render.offscreen import offscreen_plotter, open_plotter, require_offscreen
from evalkit.render.pivot_scene import pivot_scene_png

__all__ = ["head_columns", "offscreen_plotter", "open_plotter", "pivot_scene_png", "require_offscreen"]
