"""The 2.5D head: the built-in template, heads of others, and what a head must be."""

from __future__ import annotations

from pathlib import Path

from evalkit.head.model import REGIONS, Head, Jaw, Lids, read_head

__all__ = ["REGIONS", "Head", "Jaw", "Lids", "load_head"]


def load_head(source: str | Path = "template", *, vertices: int | None = None) -> Head:
    """The built-in head, or one from a file.

    Parameters
    ----------
    source : str or Path
        ``"template"``, or the path of a head file (``.npz``).
    vertices : int, optional
        Resolution of the template.

    Returns
    -------
    Head

    Raises
    ------
    EvalkitError
        If there is no such head, or a number of vertices is asked of a file.
    """
    if str(source) == "template":
        from evalkit.head.template import DEFAULT_VERTICES, make_template

        return make_template(vertices or DEFAULT_VERTICES)
    return read_head(source)
