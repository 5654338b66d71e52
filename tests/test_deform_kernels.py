"""Kernels against slow versions of themselves and against scipy's interpolator."""

from __future__ import annotations

import numpy as np
import pytest
from contracts.faces import face
from oracles import deform_oracles as slow
from scipy.interpolate import RBFInterpolator

from evalkit import deformation_map, kernels

HEAD = face(31, 41)
NAMES = list(HEAD.marker_sites)

EXACT = 1e-7
"""Condition numbers here stay below 1e5: sixteen digits less five, and two for the sums over the centres."""

SCIPY = {
    "gaussian": "gaussian",
    "multiquadric": "multiquadric",
    "inverse-multiquadric": "inverse_multiquadric",
    "thin-plate": "thin_plate_spline",
    "biharmonic": "linear",
    "cubic": "cubic",
}
"""Our name -> that of scipy's RBFInterpolator."""


SMALL = face(13, 15)
"""One for loops: 200 vertices."""


@pytest.mark.parametrize("name", sorted(slow.PHI))
@pytest.mark.parametrize("scale_mm", [25.0, 64.0])
def test_equals_the_bordered_system(name, scale_mm):
    kernel = kernels[name]
    sites = np.array(list(HEAD.marker_sites.values()))
    given = None if kernel.scale is None else scale_mm
    weights = deformation_map(HEAD, NAMES, kernel, regions=False, static=False, scale_mm=given)[::7]
    # In inter-eye distances: the thin plate of millimetres is the same map, but solved with fewer digits.
    unit = np.linalg.norm(HEAD.marker_sites["LidL"] - HEAD.marker_sites["LidR"])
    expected = slow.bordered_map(name, scale_mm / unit if given else 1.0, sites / unit, HEAD.vertices[::7] / unit)
    np.testing.assert_allclose(weights, expected, atol=EXACT)


@pytest.mark.parametrize("name", sorted(SCIPY))
def test_equals_scipy(name):
    sites = np.array(list(HEAD.marker_sites.values()))
    scale_mm = None if kernels[name].scale is None else 30.0
    weights = deformation_map(HEAD, NAMES, name, regions=False, static=False, scale_mm=scale_mm)
    peer = RBFInterpolator(sites, np.eye(len(NAMES)), kernel=SCIPY[name], epsilon=1 / (scale_mm or 1.0), degree=1)
    # scipy solves its own bordered system, in its own normalisation.
    np.testing.assert_allclose(weights, peer(HEAD.vertices), atol=EXACT)


def test_shepard_equals_the_loop():
    weights = deformation_map(SMALL, HEAD.marker_sites, "shepard", regions=False, static=False)
    expected = slow.shepard_map(np.array(list(HEAD.marker_sites.values())), SMALL.vertices)
    np.testing.assert_allclose(weights, expected, atol=1e-12)


def test_bilaplacian_equals_its_optimality_system():
    names = ["ForeheadC", "BrowOutL", "BrowOutR", "CheekL", "CheekR", "MouthL", "Chin"]
    at = [int(np.argmin(np.linalg.norm(SMALL.vertices - SMALL.marker_sites[name], axis=1))) for name in names]
    weights = deformation_map(SMALL, names, "bilaplacian", regions=False, static=False)
    # Condition number of the energy about 1e6 on this mesh.
    np.testing.assert_allclose(weights, slow.bilaplacian_map(SMALL.vertices, SMALL.triangles, at), atol=1e-6)


def test_every_oracle_has_its_kernel_and_every_kernel_an_oracle():
    checked = {*slow.PHI, "shepard", "bilaplacian", "geodesic-exponential"}  # the last: test_deform.py, on a plane
    own = {name for name, kernel in kernels.items() if not kernel.origin}
    assert own == checked


def test_control_a_wrong_phi_is_not_the_bordered_system():
    sites = np.array(list(HEAD.marker_sites.values())) / 64.0
    weights = deformation_map(HEAD, NAMES, "gaussian", regions=False, static=False, scale_mm=64.0)[::7]
    expected = slow.bordered_map("exponential", 1.0, sites, HEAD.vertices[::7] / 64.0)
    assert np.abs(weights - expected).max() > 0.1


def test_control_flat_centres_blow_up_without_care():
    sites = np.array(list(HEAD.marker_sites.values()))
    sites[:, 2] = 100.0 + 1e-3 * np.random.default_rng(6).normal(size=len(sites))
    assert np.abs(slow.bordered_map("exponential", 64.0, sites, HEAD.vertices[::7])).max() > 1000.0
