"""Slow, obvious versions of the steps of Character Transfer: loops and dense systems, nothing shared with evalkit."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.optimize
from scipy.spatial.transform import Rotation

# --- matrices ----------------------------------------------------------------------------------------------


def polar(m):
    """Nearest rotation and what is left of one matrix, by its singular values."""
    left, values, right = np.linalg.svd(m)
    if np.linalg.det(left @ right) < 0.0:
        left[:, 2] *= -1.0
        values[2] *= -1.0
    return left @ right, right.T @ np.diag(values) @ right


# --- gradients ---------------------------------------------------------------------------------------------


def fourth_vertex(a, b, c, kind="root"):
    """Of a triangle; the wrong kinds are those of public ports."""
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal)
    return a + normal / {"root": np.sqrt(length), "unit": length, "raw": 1.0}[kind]


def frame(vertices, triangle, kind="root"):
    a, b, c = (vertices[i] for i in triangle)
    return np.column_stack([b - a, c - a, fourth_vertex(a, b, c, kind) - a])


def gradients(rest, shape, triangles, kind="root"):
    """G with G V = V~ of every triangle, (T, 3, 3)."""
    out = []
    for triangle in triangles:
        before, after = frame(rest, triangle, kind), frame(shape, triangle, kind)
        out.append(np.linalg.solve(before.T, after.T).T)
    return np.array(out)


def surface_components(count, triangles):
    """Connected part of each vertex, by painting."""
    part = list(range(count))
    changed = True
    while changed:
        changed = False
        for triangle in triangles:
            lowest = min(part[i] for i in triangle)
            for i in triangle:
                changed |= part[i] != lowest
                part[i] = lowest
    return np.array(part)


# --- solve -------------------------------------------------------------------------------------------------


def solve(rest, triangles, wanted, pinned, guess):
    """Sumner and Popovic's least squares as it stands, fourth vertices among the unknowns, densely.

    ``wanted`` is (T, 3, 3). Pinned vertices are known; parts without a pin are put where the guess has their mean.
    """
    count = len(rest)
    system = np.zeros((3 * len(triangles), count + len(triangles)))
    right = np.zeros((3 * len(triangles), 3))
    for t, triangle in enumerate(triangles):
        inverse = np.linalg.inv(frame(rest, triangle))
        for column in range(3):
            row = 3 * t + column
            for edge, end in enumerate([triangle[1], triangle[2], count + t]):
                system[row, end] += inverse[edge, column]
                system[row, triangle[0]] -= inverse[edge, column]
            right[row] = wanted[t][:, column]
    known = np.flatnonzero(pinned)
    free = np.setdiff1d(np.arange(system.shape[1]), known)
    solution = np.linalg.lstsq(system[:, free], right - system[:, known] @ guess[known], rcond=None)[0]
    out = np.array(guess)
    for place, vertex in enumerate(free):
        if vertex < count:
            out[vertex] = solution[place]
    parts = surface_components(count, triangles)
    for part in set(parts.tolist()):
        members = np.flatnonzero(parts == part)
        if not pinned[members].any():
            out[members] += guess[members].mean(axis=0) - out[members].mean(axis=0)
    return out


# --- regions -----------------------------------------------------------------------------------------------


def two_means(vectors):
    """Lloyd's iteration between two centres, from the sides of the mean along the principal axis."""
    mean = np.mean(vectors, axis=0)
    axis = np.linalg.svd(vectors - mean)[2][0]
    second = [(vector - mean) @ axis > 0.0 for vector in vectors]
    while True:
        if all(second) or not any(second):
            return np.array(second)
        centres = [np.mean([v for v, s in zip(vectors, second, strict=True) if s == side], axis=0) for side in (0, 1)]
        after = [np.linalg.norm(v - centres[1]) < np.linalg.norm(v - centres[0]) for v in vectors]
        if after == second:
            return np.array(second)
        second = after


def segment(rest, triangles, fine, levels, least):
    """Partitions of the triangles, a list of sets of triangles for each level."""
    place = np.array([[rest[i] for i in triangle] for triangle in triangles]).reshape(len(triangles), -1)
    moves = np.array([[shape[i] - rest[i] for shape in fine for i in triangle] for triangle in triangles])
    moves = moves.reshape(len(triangles), -1)
    blocks = []
    for block in (place, moves):
        centred = block - block.mean(axis=0)
        blocks.append(centred / np.sqrt(centred.var(axis=0).sum()))
    found = [[set(range(len(triangles)))]]
    for level in range(1, levels + 1):
        parts = []
        for part in found[-1]:
            members = sorted(part)
            vertices = {i for t in members for i in triangles[t].tolist()}
            if len(vertices) < least:
                parts.append(part)
                continue
            vectors = np.array([[*blocks[0][t], *(level * blocks[1][t])] for t in members])
            side = two_means(vectors)
            halves = [{t for t, s in zip(members, side, strict=True) if s == which} for which in (False, True)]
            parts += [half for half in halves if half]
        found.append(parts)
    return found


# --- coefficients ------------------------------------------------------------------------------------------


def coefficients(examples, new, weight, kind):
    """Of one region and one shape: examples (n, M), new (n,), the ridge itself in the objective."""
    count = examples.shape[1]
    system = np.vstack([examples, np.sqrt(weight) * np.eye(count)])
    right = np.concatenate([new, np.zeros(count)])
    if kind == "ridge":
        return np.linalg.lstsq(system, right, rcond=None)[0]
    if kind == "non-negative":
        return scipy.optimize.nnls(system, right)[0]
    if kind == "sum-to-one":
        return plane_minimum(system, right)
    return simplex(system, right)


def plane_minimum(system, right):
    """Least squares over ``sum w = 1``: any point of the plane and directions within it."""
    count = system.shape[1]
    start, within = np.full(count, 1.0 / count), scipy.linalg.null_space(np.ones((1, count)))
    if not within.size:
        return start
    return start + within @ np.linalg.lstsq(system @ within, right - system @ start, rcond=None)[0]


def simplex(system, right):
    """Least squares over ``w >= 0, sum w <= 1`` by trying every set of active bounds."""
    count = system.shape[1]
    best, value = np.zeros(count), float(right @ right)
    for mask in range(1, 2**count):
        chosen = [k for k in range(count) if mask >> k & 1]
        for full in (False, True):
            part = system[:, chosen]
            w = plane_minimum(part, right) if full else np.linalg.lstsq(part, right, rcond=None)[0]
            if w.min() < 0.0 or w.sum() > 1.0 + 1e-12:
                continue
            cost = float(((part @ w - right) ** 2).sum())
            if cost < value:
                best, value = np.zeros(count), cost
                best[chosen] = w
    return best


# --- blending ----------------------------------------------------------------------------------------------


def blend(mappings, weights):
    """Q(w) of one triangle: mappings (M, 3, 3) with positive determinants, weights (M,)."""
    turn, stretch, most_turn, most_stretch = np.zeros(3), np.zeros((3, 3)), 0.0, 0.0
    for q, w in zip(mappings, weights, strict=True):
        r, s = polar(q)
        vector, log = Rotation.from_matrix(r).as_rotvec(), scipy.linalg.logm(s)
        most_turn, most_stretch = max(most_turn, np.linalg.norm(vector)), max(most_stretch, np.linalg.norm(log))
        turn, stretch = turn + w * vector, stretch + w * log
    # No further than the strongest example.
    turn *= min(1.0, most_turn / max(np.linalg.norm(turn), 1e-300))
    stretch *= min(1.0, most_stretch / max(np.linalg.norm(stretch), 1e-300))
    return Rotation.from_rotvec(turn).as_matrix() @ scipy.linalg.expm(stretch)


# --- all of it ---------------------------------------------------------------------------------------------


def transfer(rest, triangles, rough, fine, new, regions, *, still, ridge, quiet):
    """Fine shape for one new rough shape; ``regions`` of the vertices are given."""
    weights = np.zeros((regions.max() + 1, len(rough)))
    moving = np.array([any((shape[i] != rest[i]).any() for shape in rough) for i in range(len(rest))])
    overall = np.mean([[d @ d for d in (shape - rest)[moving]] for shape in rough])
    for region in range(regions.max() + 1):
        members = np.flatnonzero(regions == region)
        examples = np.column_stack([(shape - rest)[members].ravel() for shape in rough])
        size = np.mean([column @ column for column in examples.T])
        if size > 0.0:
            lam = ridge * max(size, quiet * overall * moving[members].sum())
            weights[region] = coefficients(examples, (new - rest)[members].ravel(), lam, "ridge")
    before = [gradients(rest, shape, triangles) for shape in rough]
    after = [gradients(rest, shape, triangles) for shape in fine]
    wanted = []
    for t, (triangle, own) in enumerate(zip(triangles, gradients(rest, new, triangles), strict=True)):
        mappings = [g[t] @ np.linalg.inv(b[t]) for g, b in zip(after, before, strict=True)]
        mean = np.mean([weights[regions[i]] for i in triangle], axis=0)
        wanted.append(blend(mappings, mean) @ own)
    size = np.linalg.norm(rest.max(axis=0) - rest.min(axis=0))
    pinned = np.array(
        [max(np.linalg.norm(shape[i] - rest[i]) for shape in (*rough, *fine)) <= still * size for i in range(len(rest))]
    )
    guess = np.array(
        [new[i] + sum(w * (f[i] - r[i]) for w, f, r in zip(weights[regions[i]], fine, rough, strict=True))
         for i in range(len(rest))]
    )  # fmt: skip
    return solve(rest, triangles, wanted, pinned, guess)


# --- example-based rigging ---------------------------------------------------------------------------------


def rig_shapes(mixtures, goal, prior, looseness):
    """Gradients of one triangle and entry: the rows of both terms stacked; mixtures (K, N), goal (K,), prior (N,)."""
    weight = 1.0 / np.sqrt(looseness)
    system = np.vstack([mixtures, np.diag(weight)])
    return np.linalg.lstsq(system, np.concatenate([goal, weight * prior]), rcond=None)[0]


def rig_mixture(start, moves, goal, weight):
    """One mixture in [0, 1]: moves (N, 3 V), goal (3 V,), start (N,), weight of the prior."""
    system = np.vstack([moves.T, np.sqrt(weight) * np.eye(len(moves))])
    right = np.concatenate([goal, np.sqrt(weight) * start])
    return scipy.optimize.lsq_linear(system, right, bounds=(0.0, 1.0), tol=1e-14, lsq_solver="exact").x
