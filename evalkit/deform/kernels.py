"""Kernels: how far and how smoothly a marker's displacement reaches. One function, one line in the table.

Examples
--------
>>> import evalkit
>>> list(evalkit.kernels)[:3]
['exponential', 'gaussian', 'multiquadric']
>>> evalkit.kernels["thin-plate"].order
2
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evalkit.deform.interpolation import Interpolant, rbf, shepard
from evalkit.deform.surface import bilaplacian, from_nearest, heat_distances
from evalkit.geometry import Array
from evalkit.plugins import Table


@dataclass(frozen=True, eq=False)
class Sites:
    """Where a field is given and where it is wanted. Lengths are in inter-eye distances.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
    triangles : ndarray, shape (T, 3)
    centres : ndarray, shape (N, 3)
    at : ndarray, shape (N,)
        The vertex nearest to each centre.
    """

    vertices: Array
    triangles: np.ndarray
    centres: Array
    at: np.ndarray


@dataclass(frozen=True)
class Kernel:
    """One entry of the table of kernels.

    Attributes
    ----------
    phi : callable or None
        ``phi(r / scale)`` elementwise, or None for a method that is not made of radial functions.
    degree : int
        Degree of the polynomials that are reproduced: 1 affine fields, 0 constants, -1 none.
    order : int or None
        ``(-1)^order phi`` is conditionally positive definite of this order in three dimensions: 0 is positive
        definite, and ``degree`` must be at least ``order - 1``. None where nothing is claimed.
    scale : float or None
        Default of the length that r is divided by, as a fraction of the inter-eye distance; None if the map does
        not depend on it.
    summary, source : str
        One line on the kernel, and where it comes from.
    distances : callable or None
        ``Sites -> (N, V)``, distances from centres to vertices in place of straight lines.
    weights : callable or None
        ``Sites -> (V, N)`` for a method that is not made of radial functions.
    origin : str
        The distribution that brought the entry, if it is not evalkit.

    Examples
    --------
    The paper's kernel falls to 1/e at its scale, which is the distance between the eyes:

    >>> import numpy as np
    >>> import evalkit
    >>> kernel = evalkit.kernels["exponential"]
    >>> kernel.scale, kernel.phi(np.array([0.0, 1.0])).round(3)
    (1.0, array([1.   , 0.368]))
    """

    phi: Callable[[Array], Array] | None
    degree: int
    order: int | None
    scale: float | None
    summary: str
    source: str
    distances: Callable[[Sites], Array] | None = None
    weights: Callable[[Sites], Array] | None = None
    origin: str = ""

    def interpolate(self, sites: Sites, scale: float | None = None, slopes: int = 3) -> Interpolant:
        """The map from values at the centres to values at the vertices.

        The scale is in inter-eye distances; `slopes` is the number of directions that the affine part may use.
        """
        if self.weights is not None:
            return Interpolant(self.weights(sites))
        assert self.phi is not None
        length = scale or self.scale or 1.0
        if self.distances is None:
            towards = euclidean(sites.vertices, sites.centres)
            among, centres = euclidean(sites.centres, sites.centres), sites.centres
        else:
            towards = self.distances(sites).T
            among, centres = towards[sites.at], sites.vertices[sites.at]
            reached = np.asarray(np.isfinite(towards).any(axis=1))
            towards = from_nearest(towards, sites.vertices, reached)
        return rbf(self.phi(among / length), self.phi(towards / length), centres, sites.vertices, self.degree, slopes)


def euclidean(points: Array, centres: Array) -> Array:
    """Distances (K, N) along straight lines, exactly zero where a point is a centre."""
    return np.asarray(np.sqrt(sum((points[:, None, i] - centres[None, :, i]) ** 2 for i in range(3))))


def exponential(r: Array) -> Array:
    """``exp(-r)``, the paper's."""
    return np.exp(-r)


def gaussian(r: Array) -> Array:
    """``exp(-r^2)``."""
    return np.exp(-(r**2))


def multiquadric(r: Array) -> Array:
    """``sqrt(1 + r^2)``."""
    return np.sqrt(1 + r**2)


def inverse_multiquadric(r: Array) -> Array:
    """``1 / sqrt(1 + r^2)``."""
    return 1 / np.sqrt(1 + r**2)


def thin_plate(r: Array) -> Array:
    """``r^2 log r``, zero at zero."""
    return r**2 * np.log(np.where(r > 0, r, 1.0))


def biharmonic(r: Array) -> Array:
    """``r``, the thin plate of three dimensions."""
    return r


def cubic(r: Array) -> Array:
    """``r^3``, the volume spline."""
    return r**3


def wendland_c2(r: Array) -> Array:
    """``(1 - r)^4 (4 r + 1)`` up to 1, zero beyond."""
    return np.asarray(np.maximum(1 - r, 0.0) ** 4 * (4 * r + 1))


def matern_3_2(r: Array) -> Array:
    """``(1 + s) exp(-s)``, s = sqrt(3) r."""
    s = np.sqrt(3.0) * r
    return np.asarray((1 + s) * np.exp(-s))


def matern_5_2(r: Array) -> Array:
    """``(1 + s + s^2 / 3) exp(-s)``, s = sqrt(5) r."""
    s = np.sqrt(5.0) * r
    return np.asarray((1 + s + s**2 / 3) * np.exp(-s))


def shepard_weights(sites: Sites) -> Array:
    """Shepard's inverse squared distances, straight lines."""
    return shepard(euclidean(sites.vertices, sites.centres))


def bilaplacian_weights(sites: Sites) -> Array:
    """Bi-Laplacian weights; the centres are moved to their nearest vertices."""
    return bilaplacian(sites.vertices, sites.triangles, sites.at)


def geodesic(sites: Sites) -> Array:
    """Heat-method distances from the vertices nearest to the centres."""
    return heat_distances(sites.vertices, sites.triangles, sites.at)


OWN: dict[str, Kernel] = {
    "exponential": Kernel(exponential, 1, 0, 1.0, "the paper's, a kink at each marker", "Huang et al. 2000, Eq. (10)"),
    "gaussian": Kernel(gaussian, 1, 0, 0.5, "analytic and badly conditioned", "doi:10.1017/CBO9780511617539"),
    "multiquadric": Kernel(multiquadric, 1, 1, 0.5, "grows like r, smooth at the marker", "Hardy 1971"),
    "inverse-multiquadric": Kernel(inverse_multiquadric, 1, 0, 0.5, "decays like 1/r", "Hardy 1971"),
    "thin-plate": Kernel(thin_plate, 1, 2, None, "r^2 log r, no scale to choose", "Duchon 1977"),
    "biharmonic": Kernel(biharmonic, 1, 1, None, "r, the thin plate in three dimensions", "Duchon 1977"),
    "cubic": Kernel(cubic, 1, 2, None, "r^3, the volume spline", "Duchon 1977; Nielson 1993"),
    "wendland-c2": Kernel(wendland_c2, 1, 0, 2.0, "zero beyond its scale", "Wendland 1995, doi:10.1007/BF02123482"),
    "matern-3-2": Kernel(matern_3_2, 1, 0, 1.0, "once differentiable", "Stein 1999"),
    "matern-5-2": Kernel(matern_5_2, 1, 0, 1.0, "twice differentiable", "Stein 1999"),
    "shepard": Kernel(
        None, 0, None, None, "inverse-distance mean, no radial functions", "Shepard 1968", weights=shepard_weights
    ),
    "geodesic-exponential": Kernel(
        exponential, 1, None, 1.0, "the paper's over surface distance", "doi:10.1145/2516971.2516977", geodesic
    ),
    "bilaplacian": Kernel(
        None, 0, None, None, "smoothest field on the surface", "doi:10.1109/TVCG.2007.1054", weights=bilaplacian_weights
    ),
}
"""The kernels of this package. The scales are round numbers near the distance between markers, not tuned."""

kernels = Table(OWN, "evalkit.kernels", Kernel)
"""Name to kernel, plugins included; tests, the command line, studies and figures take their lists from here."""
