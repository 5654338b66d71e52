"""Drawing without a screen, and saying what to install where that cannot work.

VTK ends the process with a segmentation fault where it finds no way to draw. What it needs is therefore
tried first in a process of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from evalkit.errors import EvalkitError

if TYPE_CHECKING:
    import pyvista

APT_LINE = "sudo apt-get install libegl1 libgl1-mesa-dri"
"""What a Debian or Ubuntu without a desktop lacks: EGL, and Mesa's software renderer behind it."""

EGL_LIBRARY = "libEGL.so.1"

WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
"""Names the kind of window that VTK opens; EGL's needs neither an X server nor X libraries."""

# Device display, initialise: what VTK's EGL window does first, and where it fails for want of a driver.
PROBE = """
import ctypes, sys
pointer, integer = ctypes.c_void_p, ctypes.c_int
try:
    egl = ctypes.CDLL(sys.argv[1])
except OSError:
    sys.exit("the library " + sys.argv[1] + " is missing")
egl.eglGetProcAddress.restype = pointer
egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
egl.eglInitialize.argtypes = [pointer, pointer, pointer]
query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
platform = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
if not (query and platform):
    sys.exit("EGL lists no devices")
query = ctypes.CFUNCTYPE(ctypes.c_uint, integer, ctypes.POINTER(pointer), ctypes.POINTER(integer))(query)
platform = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, pointer, ctypes.POINTER(integer))(platform)
devices, count = (pointer * 64)(), integer()
query(64, devices, ctypes.byref(count))
for device in devices[:count.value]:
    display = platform(0x313F, device, None)  # EGL_PLATFORM_DEVICE_EXT
    if display and egl.eglInitialize(display, None, None):
        sys.exit(0)
sys.exit("EGL finds no driver to draw with")
"""


def require_offscreen() -> None:
    """Check that pictures can be drawn without a screen, before VTK is touched.

    Raises
    ------
    EvalkitError
        If not; its line says what to install.
    """
    if not sys.platform.startswith("linux"):
        return
    problem = _probe(EGL_LIBRARY)
    if problem:
        raise EvalkitError(f"no picture can be drawn without a screen here: {problem}; install it with: {APT_LINE}")


@lru_cache(maxsize=4)
def _probe(library: str) -> str:
    """What is missing, in words; empty if nothing is."""
    try:
        done = subprocess.run(
            [sys.executable, "-I", "-S", "-c", PROBE, library], capture_output=True, text=True, timeout=60
        )
    except (OSError, subprocess.SubprocessError) as error:
        return f"EGL could not be tried ({type(error).__name__})"
    if done.returncode == 0:
        return ""
    lines = done.stderr.strip().splitlines()
    # A negative code is a signal: the driver itself crashed.
    return lines[-1] if done.returncode > 0 and lines else "the EGL driver crashes"


@contextmanager
def offscreen_plotter(width: int, height: int, **options: Any) -> Iterator[pyvista.Plotter]:
    """A PyVista plotter without a window, closed at the end.

    Parameters
    ----------
    width, height : int
        Picture size, pixels.
    **options
        Handed to :class:`pyvista.Plotter`.

    Raises
    ------
    EvalkitError
        If nothing can be drawn here.
    """
    plotter = open_plotter(width, height, **options)
    try:
        yield plotter
    finally:
        plotter.close()


def open_plotter(width: int, height: int, **options: Any) -> pyvista.Plotter:
    """A PyVista plotter without a window that stays open: in a notebook its ``show()`` is a view to turn and zoom.

    That needs PyVista's extra ``jupyter``; without it ``show()`` displays a still picture.

    Parameters
    ----------
    width, height, **options
        As for :func:`offscreen_plotter`.

    Raises
    ------
    EvalkitError
        If nothing can be drawn here.
    """
    require_offscreen()
    try:
        with warnings.catch_warnings():
            # PyVista's progress bars miss a package in notebooks; none of them is shown here.
            warnings.filterwarnings("ignore", "IProgress not found")
            import pyvista
    except ImportError as error:
        # VTK before 9.4 links against libGL and X and cannot even be imported without them.
        raise EvalkitError(f"VTK cannot be loaded ({error}); install it with: {APT_LINE} libgl1 libxrender1") from error
    before = os.environ.get(WINDOW_VARIABLE)
    if sys.platform.startswith("linux"):
        os.environ.setdefault(WINDOW_VARIABLE, "vtkEGLRenderWindow")
    try:
        return pyvista.Plotter(off_screen=True, window_size=[width, height], **options)
    finally:
        # Windows that a user opens on his screen are none of our business.
        if before is None:
            os.environ.pop(WINDOW_VARIABLE, None)
