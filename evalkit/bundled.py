"""The small synthetic takes that come with the package."""

from __future__ import annotations

from pathlib import Path

from evalkit.errors import EvalkitError


def bundled_folder() -> Path:
    """The folder of the bundled takes and their MANIFEST.json.

    Raises
    ------
    EvalkitError
        If this installation has none.
    """
    here = Path(__file__).parent
    # In a wheel the takes lie inside the package, in a checkout beside it.
    for folder in (here / "data" / "synthetic", here.parent / "data" / "synthetic"):
        if (folder / "MANIFEST.json").is_file():
            return folder
    raise EvalkitError("this installation has no bundled takes; make a set with: evalkit synth --reference -o DIR")


def bundled_take(name: str) -> tuple[Path, Path]:
    """Paths of a bundled capture and its truth.

    Raises
    ------
    EvalkitError
        If there is no such take in this installation.
    """
    folder = bundled_folder()
    capture, truth = folder / f"{name}.c3d", folder / f"{name}.truth.npz"
    if capture.is_file() and truth.is_file():
        return capture, truth
    raise EvalkitError(f"the bundled take '{name}' is not in this installation; make one with: evalkit synth {name}")
