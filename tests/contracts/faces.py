"""A face of a formula with a mouth slit, as a head for the tests of the deformation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evalkit.synthetic.layouts import PAPER_23

MOUTH = -35.0
"""Height of the mouth slit, mm."""

HALF_WIDTH = 27.0
"""Half the width of the mouth, mm."""


@dataclass(frozen=True, eq=False)
class FormulaHead:
    """What a deformation map needs of a head."""

    vertices: np.ndarray
    triangles: np.ndarray
    marker_sites: dict[str, np.ndarray]
    regions: dict[str, np.ndarray]

    def moved(self, rotation=None, translation=0.0, scale=1.0):
        """The same head in other axes and another unit."""
        r = np.eye(3) if rotation is None else rotation
        sites = {name: scale * (r @ place) + translation for name, place in self.marker_sites.items()}
        return FormulaHead(scale * self.vertices @ r.T + translation, self.triangles, sites, self.regions)


def face(columns=61, rows=81):
    """A face as a height field over x in +-90 and y in -150..130 mm, the mouth cut open, 4,967 vertices by default."""
    x = np.linspace(-90.0, 90.0, columns)
    y = np.linspace(-150.0, 130.0, rows)
    y[np.argmin(np.abs(y - MOUTH))] = MOUTH
    gx, gy = np.meshgrid(x, y)
    z = 118.0 - 55.0 * (gx / 80.0) ** 2 - 30.0 * ((gy - 10.0) / 130.0) ** 2
    z += 18.0 * np.exp(-((gx / 14.0) ** 2) - ((gy - 5.0) / 18.0) ** 2)
    z += 4.0 * np.exp(-((gx / 22.0) ** 2) - ((gy - MOUTH) / 14.0) ** 2)
    vertices = np.stack([gx, gy, z], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(rows, columns)
    slit = int(np.flatnonzero(y == MOUTH)[0])
    inside = np.abs(x) < HALF_WIDTH - 1e-9
    below = index.copy()
    below[slit, inside] = len(vertices) + np.arange(inside.sum())
    vertices = np.vstack([vertices, vertices[index[slit, inside]] - [0.0, 0.2, 0.0]])
    triangles = []
    for r in range(rows - 1):
        low, high = index[r], (below if r + 1 == slit else index)[r + 1]
        for c in range(columns - 1):
            a, b, d, e = low[c], low[c + 1], high[c], high[c + 1]
            triangles += [[a, b, e], [a, e, d]] if (r + c) % 2 else [[a, b, d], [b, e, d]]
    triangles = np.array(triangles)
    px, py = vertices[:, 0], vertices[:, 1]
    lower_row = np.arange(len(vertices)) >= rows * columns
    height = 13.0 * np.sqrt(np.clip(1.0 - (px / (HALF_WIDTH + 1.0)) ** 2, 0.0, None))
    mouth = (np.abs(py - MOUTH) < height) & (np.abs(px) <= HALF_WIDTH + 1e-9)
    upper = mouth & (py >= MOUTH) & ~lower_row
    lower = mouth & ~upper
    neck = py < -110.0
    rim = ((np.abs(px) > 78.0) | (py > 118.0)) & ~neck
    regions = {
        "hindbrain": np.flatnonzero(rim),
        "neck": np.flatnonzero(neck),
        "upper lip": np.flatnonzero(upper),
        "lower lip": np.flatnonzero(lower),
        "face": np.flatnonzero(~(rim | neck | mouth)),
    }
    return FormulaHead(vertices, triangles, _sites_on(vertices, upper, lower), regions)


def _sites_on(vertices, upper, lower):
    """Positions of the vertices nearest to the paper's marker sites, each lip's on its own side of the slit."""
    sites = {}
    for name, place in PAPER_23.items():
        allowed = ~lower if name.startswith("UpperLip") else ~upper if name.startswith("LowerLip") else ~(upper & lower)
        candidates = np.flatnonzero(allowed)
        sites[name] = vertices[candidates[np.argmin(np.linalg.norm(vertices[candidates, :2] - place[:2], axis=1))]]
    return sites
