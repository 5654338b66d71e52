"""The 2.5D head: the built-in template, heads of others, and what a head must be."""

from __future__ import annotations

from pathlib import Path

from evalkit.errors import EvalkitError
from evalkit.head.model import REGIONS, Head, Jaw, Lids, read_head, turned_too_far

__all__ = ["REGIONS", "Head", "Jaw", "Lids", "load_head", "turned_too_far"]


def load_head(source: str | Path = "template", *, vertices: int | None = None) -> Head:
    """The built-in head, or one from a file.

    Parameters
    ----------
    source : str or Path
        ``"template"``; ``"makehuman"`` after ``evalkit head get makehuman``; a head file (``.npz``) or the folder
        with its ``head.npz``; or a mesh file of others as :func:`evalkit.head.importing.import_head` reads it.
    vertices : int, optional
        Resolution of the template.

    Returns
    -------
    Head

    Raises
    ------
    EvalkitError
        If there is no such head, or a number of vertices is asked of a file.

    Examples
    --------
    >>> import evalkit
    >>> head = evalkit.load_head("template")
    >>> head.vertices.shape, head.triangles.shape
    ((11272, 3), (21888, 3))
    >>> len(head.marker_sites), list(head.marker_sites)[:3]
    (23, ['ForeheadC', 'ForeheadL', 'ForeheadR'])
    >>> list(head.regions)
    ['hindbrain', 'neck', 'face', 'upper lip', 'lower lip']
    """
    if str(source) == "template":
        from evalkit.head.cached import kept_template

        return kept_template(vertices)
    if vertices is not None:
        raise EvalkitError(f"{source}: only the template can be made with another number of vertices")
    if str(source) == "makehuman":
        from evalkit.head.makehuman import cached_head

        if not cached_head().is_file():
            raise EvalkitError("MakeHuman's head is not here yet; get it with: evalkit head get makehuman")
        return read_head(cached_head())
    if Path(source).suffix == ".npz":
        return read_head(source)
    if (Path(source) / "head.npz").is_file():
        return read_head(Path(source) / "head.npz")
    from evalkit.head.importing import import_head

    return import_head(source)
