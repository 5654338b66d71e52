"""Marker layouts: where on a face the markers sit, and which of them are taken as rigid with the skull.

Every site was read off the neutral face of ICT-FaceKit [1]_: the skin vertex nearest to the wanted place in the
frontal plane, mean of the vertices around it, rounded to 0.5 mm, left and right made symmetric. The face has
adult proportions: outer eye corners 89 mm apart, nasion to chin 113 mm. Axes and origin are those of the head
frame, see `evalkit.synthetic.performer`.

References
----------
.. [1] R. Li et al., "Learning Formation of Physically-Based Face Attributes", CVPR 2020; ICT-FaceKit,
   https://github.com/ICT-VGL/ICT-FaceKit, MIT licence.
"""

from __future__ import annotations

from dataclasses import dataclass

Site = tuple[float, float, float]

PAPER_23: dict[str, tuple[float, float, float]] = {
    # the rigid triangle on the forehead
    "ForeheadC": (0.0, 104.5, 90.5),
    "ForeheadL": (22.5, 76.5, 100.5),
    "ForeheadR": (-22.5, 76.5, 100.5),
    "BrowInL": (15.0, 60.0, 107.0),
    "BrowInR": (-15.0, 60.0, 107.0),
    "BrowOutL": (47.0, 60.5, 92.0),
    "BrowOutR": (-47.0, 60.5, 92.0),
    "LidL": (32.0, 40.0, 95.5),
    "LidR": (-32.0, 40.0, 95.5),
    "NoseBridge": (0.0, 35.5, 108.5),
    "NoseL": (16.0, -6.0, 112.5),
    "NoseR": (-16.0, -6.0, 112.5),
    "CheekL": (45.0, 0.0, 93.5),
    "CheekR": (-45.0, 0.0, 93.5),
    "UpperLipC": (0.0, -23.5, 117.5),
    "UpperLipL": (12.0, -25.0, 115.0),
    "UpperLipR": (-12.0, -25.0, 115.0),
    "MouthL": (27.0, -35.0, 102.0),
    "MouthR": (-27.0, -35.0, 102.0),
    "LowerLipC": (0.0, -45.5, 113.5),
    "LowerLipL": (13.0, -43.5, 111.5),
    "LowerLipR": (-13.0, -43.5, 111.5),
    "Chin": (0.0, -65.5, 110.0),
}
"""Label -> marker site in the head frame, mm: 23 markers as in Huang, Lin & Ouhyoung 2000, Fig. 1(b)."""


def both_sides(left: dict[str, Site]) -> dict[str, Site]:
    """Sites of the left side, labels ending in L, followed each by its mirror image, ending in R."""
    sites = {}
    for label, (x, y, z) in left.items():
        sites[label] = (x, y, z)
        sites[f"{label[:-1]}R"] = (-x, y, z)
    return sites


DENSE_63: dict[str, Site] = {
    **PAPER_23,
    "Nasion": (0.0, 49.5, 107.0),
    "NoseMid": (0.0, 21.0, 119.0),
    "NoseTip": (0.0, 1.0, 130.5),
    "ChinTop": (0.0, -57.0, 110.0),
    **both_sides(
        {
            "ForeheadOutL": (47.5, 83.0, 82.0),
            "BrowMidL": (30.5, 65.0, 101.5),
            "TempleL": (60.5, 57.0, 72.5),
            "LidLowL": (31.5, 22.5, 94.5),
            "EyeOutL": (52.0, 34.0, 82.0),
            "NoseSideL": (9.0, 21.5, 110.0),
            "CheekInL": (27.0, 8.5, 99.0),
            "CheekUpL": (51.0, 17.0, 86.5),
            "CheekOutL": (63.0, 10.5, 75.0),
            "CheekLowL": (41.5, -17.5, 95.0),
            "CheekBackL": (63.0, -15.0, 66.0),
            "FoldL": (28.0, -16.0, 102.0),
            "UpperLipOutL": (20.0, -29.5, 109.5),
            "LowerLipOutL": (22.0, -40.5, 105.0),
            "ChinSideL": (18.0, -63.0, 104.5),
            "JawInL": (29.0, -52.5, 97.0),
            "JawL": (43.5, -39.5, 88.5),
            "JawBackL": (57.0, -35.0, 69.5),
        }
    ),
}
"""Label -> site: the 23 of the paper and 40 between and around them."""

FOREHEAD = ("ForeheadC", "ForeheadL", "ForeheadR")
"""The forehead triangle, which the paper takes as rigid."""

REDUCED_12 = (
    *FOREHEAD, "NoseBridge", "BrowOutL", "BrowOutR", "CheekL", "CheekR", "MouthL", "MouthR", "LowerLipC", "Chin",
)  # fmt: skip
"""Out of the paper's markers, as many as a capture with few cameras keeps apart."""


@dataclass(frozen=True)
class Layout:
    """A set of markers on the average face.

    Parameters
    ----------
    text : str
        One line on what it is.
    sites : dict
        Label -> site in the head frame, mm.
    rigid : tuple of str
        The labels taken as rigid with the skull.
    """

    text: str
    sites: dict[str, Site]
    rigid: tuple[str, ...]


LAYOUTS: dict[str, Layout] = {
    "paper-23": Layout("the paper's 23; rigid: the forehead triangle", PAPER_23, FOREHEAD),
    "dense-63": Layout(
        "63 all over the face; rigid: five on the forehead, two on the bridge of the nose",
        DENSE_63,
        (*FOREHEAD, "ForeheadOutL", "ForeheadOutR", "Nasion", "NoseBridge"),
    ),
    "reduced-12": Layout(
        "12 of the paper's; rigid: the forehead triangle and the bridge of the nose",
        {label: PAPER_23[label] for label in REDUCED_12},
        (*FOREHEAD, "NoseBridge"),
    ),
}
"""Name -> marker layout."""
