"""Slow, obvious versions of the deformation maps: loops and one dense system, nothing shared with evalkit."""

from __future__ import annotations

import math

import numpy as np

PHI = {
    "exponential": lambda r: math.exp(-r),
    "gaussian": lambda r: math.exp(-r * r),
    "multiquadric": lambda r: math.hypot(1.0, r),
    "inverse-multiquadric": lambda r: 1.0 / math.hypot(1.0, r),
    "thin-plate": lambda r: r * r * math.log(r) if r > 0 else 0.0,
    "biharmonic": lambda r: r,
    "cubic": lambda r: r * r * r,
    "wendland-c2": lambda r: (1 - r) ** 4 * (4 * r + 1) if r < 1 else 0.0,
    "matern-3-2": lambda r: (1 + math.sqrt(3) * r) * math.exp(-math.sqrt(3) * r),
    "matern-5-2": lambda r: (1 + math.sqrt(5) * r + 5 * r * r / 3) * math.exp(-math.sqrt(5) * r),
}


def bordered_map(name, scale, centres, points):
    """Weights (K, N) by Eq. (11) as it stands: the bordered system in the given coordinates, solved densely."""
    n = len(centres)
    phi = PHI[name]
    system = np.zeros((n + 4, n + 4))
    for i in range(n):
        for j in range(n):
            system[i, j] = phi(math.dist(centres[i], centres[j]) / scale)
        system[i, n : n + 3] = system[n : n + 3, i] = centres[i]
        system[i, n + 3] = system[n + 3, i] = 1.0
    solution = np.linalg.solve(system, np.eye(n + 4)[:, :n])
    rows = np.zeros((len(points), n + 4))
    for k, point in enumerate(points):
        rows[k] = [*(phi(math.dist(point, centre) / scale) for centre in centres), *point, 1.0]
    return rows @ solution


def shepard_map(centres, points):
    """Inverse squared distances, normalised."""
    weights = np.zeros((len(points), len(centres)))
    for k, point in enumerate(points):
        squared = [math.dist(point, centre) ** 2 for centre in centres]
        if min(squared) == 0.0:
            weights[k, squared.index(0.0)] = 1.0
        else:
            weights[k] = [1.0 / s for s in squared]
            weights[k] /= weights[k].sum()
    return weights


def bilaplacian_map(vertices, triangles, at):
    """Minimiser of the squared cotangent Laplacian with given values at some vertices, from its optimality system."""
    count = len(vertices)
    laplacian, mass = np.zeros((count, count)), np.zeros(count)
    for triangle in triangles:
        for i, j, k in (triangle, np.roll(triangle, 1), np.roll(triangle, 2)):
            a, b = vertices[j] - vertices[i], vertices[k] - vertices[i]
            angle = math.acos(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
            half = 0.5 / math.tan(angle)
            laplacian[j, j] += half
            laplacian[k, k] += half
            laplacian[j, k] -= half
            laplacian[k, j] -= half
            mass[i] += 0.5 * np.linalg.norm(a) * np.linalg.norm(b) * math.sin(angle) / 3.0
    energy = laplacian @ np.diag(1.0 / mass) @ laplacian
    given = np.zeros((len(at), count))
    given[np.arange(len(at)), at] = 1.0
    system = np.block([[energy, given.T], [given, np.zeros((len(at), len(at)))]])
    right = np.vstack([np.zeros((count, len(at))), np.eye(len(at))])
    return np.linalg.solve(system, right)[:count]
