"""Which marker of a take sits on which marker site of a head, by its label.

Tried in this order: the mapping that the user gives; labels that are site names; the sets of labels that come with
the package (``label_sets``), of which the one that knows most labels is taken.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from evalkit.errors import EvalkitError

BY_POSITION = "position"
"""Name of the mapping that looks at no label."""

FEWEST = 4
"""Sites that must be known before a set of labels is taken for that of the take: three markers give an alignment, and
a fourth one something to move."""


def label_sets() -> dict[str, dict[str, str]]:
    """The sets of labels that come with the package: name -> label -> marker site."""
    folder = files("evalkit.animation") / "label_sets"
    found = sorted((entry for entry in folder.iterdir() if entry.name.endswith(".json")), key=lambda entry: entry.name)
    return {entry.name.removesuffix(".json"): json.loads(entry.read_text(encoding="utf-8")) for entry in found}


def read_label_map(text: str) -> dict[str, str]:
    """A mapping of labels to marker sites as a user gives it.

    Parameters
    ----------
    text : str
        A name out of :func:`label_sets`, the path of a JSON file with ``{"label": "site", ...}``, or
        ``Label=Site,Label=Site``.

    Returns
    -------
    dict of str to str

    Raises
    ------
    EvalkitError
        If the file cannot be read or is no such mapping, or the text is none of the three.
    """
    known = label_sets()
    if text in known:
        return known[text]
    if "=" in text and not Path(text).is_file():
        pairs = [part.partition("=") for part in text.split(",") if part.strip()]
        bad = next((label for label, equals, site in pairs if not (label.strip() and equals and site.strip())), None)
        if bad is not None:
            raise EvalkitError(f"mapping '{bad}' is not Label=Site; example: Mouth_Up=UpperLipC,Chin=Chin")
        return {label.strip(): site.strip() for label, _, site in pairs}
    path = Path(text)
    if not path.is_file():
        raise EvalkitError(f"{text}: neither a file, nor Label=Site,..., nor one of {', '.join(known)}, {BY_POSITION}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise EvalkitError(f"{path}: not a JSON file ({error})".splitlines()[0]) from error
    if not isinstance(content, dict) or not all(isinstance(site, str) for site in content.values()):
        raise EvalkitError(f'{path}: expected labels and sites as {{"Mouth_Up": "UpperLipC", ...}}')
    return content


def match_labels(
    labels: Sequence[str], sites: Iterable[str], given: Mapping[str, str] | None = None
) -> tuple[dict[str, str], str]:
    """Marker site -> label of the take, and in words how it was found.

    Parameters
    ----------
    labels : sequence of str
        Of the take. A prefix up to a colon, the subject's name in many files, does not count.
    sites : iterable of str
        Marker sites of the head.
    given : mapping of str to str, optional
        Label -> site, the user's own; then nothing else is tried.

    Raises
    ------
    EvalkitError
        If the user's mapping names an unknown label or site or a site twice, or nothing matches; the nearest
        names are suggested.
    """
    sites = list(sites)
    # The first of two subjects' markers counts.
    plain = {label.rpartition(":")[2]: label for label in reversed(labels)} | {label: label for label in labels}
    if given is not None:
        return _checked(given, plain, labels, sites), "by the mapping given"
    folded = {_folded(name): label for name, label in reversed(plain.items())}
    own = {site: folded[_folded(site)] for site in sites if _folded(site) in folded}
    found = {"by their names": own} | {
        f"by the labels of {name}": {
            site: plain[label] for label, site in known.items() if label in plain and site in sites
        }
        for name, known in label_sets().items()
    }  # fmt: skip
    how = max(found, key=lambda name: len(found[name]))
    if len(found[how]) < FEWEST:
        raise EvalkitError(_unmatched(labels, sites))
    return found[how], how


def _checked(
    given: Mapping[str, str], plain: Mapping[str, str], labels: Sequence[str], sites: Sequence[str]
) -> dict[str, str]:
    found: dict[str, str] = {}
    for label, site in given.items():
        if label not in plain:
            raise EvalkitError(f"mapping: the take has no marker '{label}'{_hint(label, labels)}")
        if site not in sites:
            raise EvalkitError(f"mapping of {label}: the head has no marker site '{site}'{_hint(site, sites)}")
        if site in found:
            raise EvalkitError(f"mapping: both {found[site]} and {label} are put on {site}; leave one of them out")
        found[site] = plain[label]
    return found


def _unmatched(labels: Sequence[str], sites: Sequence[str]) -> str:
    """One line with the sites that labels look like, most alike first."""
    rated = []
    for label in labels:
        name = _folded(label.rpartition(":")[2])
        alike = [(difflib.SequenceMatcher(None, name, _folded(site)).ratio(), site) for site in sites]
        rated.append((*max(alike, default=(0.0, "")), label))
    likely = [f"{label}={site}" for ratio, site, label in sorted(rated, reverse=True)[:4] if ratio > 0.5]
    example = ",".join(likely) if likely else f"{labels[0]}={sites[0]}" if labels and sites else "Label=Site"
    return (
        f"hardly any label is a marker site of the head; say which is which with --map {example},... "
        f"or place all by --map {BY_POSITION}; sites are {', '.join(sites)}"
    )


def _hint(name: str, known: Sequence[str]) -> str:
    lower = {entry.lower(): entry for entry in known}
    near = [lower[n] for n in difflib.get_close_matches(name.lower(), lower, n=2, cutoff=0.5)]
    return f"; did you mean {' or '.join(near)}?" if near else f"; it has {', '.join(known[:12])}"


def _folded(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalnum())
