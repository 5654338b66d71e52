"""Slow, obvious versions of the Fisher information and of the joint maximum likelihood; nothing shared with evalkit."""

from __future__ import annotations

import numpy as np
import scipy.interpolate
import scipy.optimize
from scipy.spatial.transform import Rotation


def crossing(vector):
    """Matrix of ``v x .``."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def spline_matrix(frames, spans):
    """Uniform cubic B-splines over the take, dense (F, spans + 3), by scipy."""
    knots = np.arange(-3, spans + 4, dtype=float)
    at = np.linspace(0.0, spans, frames)
    return scipy.interpolate.BSpline.design_matrix(at, knots, 3).toarray()


def dense_bound(shape, rotations, sigma, visible=None, gauge="frame 0"):
    """Bound of a resting pivot from the whole Fisher matrix of (P, O, every turn), by loops.

    The model is that of a reference pose, ``x = R_i (P_j - O) + O``. One turn has to be held, or the head's axes
    are free: that of a frame, or (gauge "markers") three coordinates of markers instead.
    """
    frames, count = len(rotations), len(shape)
    sigma = np.broadcast_to(sigma, (count,))
    reach = np.abs(shape).max()  # turns in units of an arc, so that all parameters are lengths
    at_pivot = 3 * count
    size = 3 * count + 3 + 3 * frames
    fisher = np.zeros((size, size))
    for i in range(frames):
        for j in range(count):
            if visible is not None and not visible[i, j]:
                continue
            jacobian = np.zeros((3, size))
            jacobian[:, 3 * j : 3 * j + 3] = rotations[i]
            jacobian[:, at_pivot : at_pivot + 3] = np.eye(3) - rotations[i]
            at_turn = at_pivot + 3 + 3 * i
            jacobian[:, at_turn : at_turn + 3] = -rotations[i] @ crossing(shape[j]) / reach
            fisher += jacobian.T @ jacobian / sigma[j] ** 2
    return _inverse_block(fisher, at_pivot, gauge, shape)


def dense_path_bound(shape, rotations, sigma, functions, frame=None, visible=None, gauge="frame 0"):
    """The same with a path, ``x = R_i p_j + sum_k B_ik a_k``, B dense (F, K): mean pivot, or that of one frame."""
    frames, count, many = len(rotations), len(shape), functions.shape[1]
    sigma = np.broadcast_to(sigma, (count,))
    reach = np.abs(shape).max()
    size = 3 * count + 3 * many + 3 * frames
    fisher = np.zeros((size, size))
    for i in range(frames):
        for j in range(count):
            if visible is not None and not visible[i, j]:
                continue
            jacobian = np.zeros((3, size))
            jacobian[:, 3 * j : 3 * j + 3] = rotations[i]
            for k in range(many):
                start = 3 * count + 3 * k
                jacobian[:, start : start + 3] = functions[i, k] * np.eye(3)
            at_turn = 3 * count + 3 * many + 3 * i
            jacobian[:, at_turn : at_turn + 3] = -rotations[i] @ crossing(shape[j]) / reach
            fisher += jacobian.T @ jacobian / sigma[j] ** 2
    weights = functions.mean(axis=0) if frame is None else functions[frame]
    kept = _kept(size, 3 * count + 3 * many, gauge, shape)
    functional = np.zeros((size, 3))
    functional[3 * count : 3 * count + 3 * many] = np.kron(weights[:, None], np.eye(3))
    functional = functional[kept]
    return functional.T @ _solved(fisher[np.ix_(kept, kept)], functional)


def _kept(size, first_turn, gauge, shape):
    """Parameters that are estimated once the gauge is fixed."""
    if gauge == "markers":
        # Three coordinates that a turn of the head's axes would change, each by one component of the turn.
        held = _three_coordinates(shape)
    else:
        frame = int(gauge.removeprefix("frame "))
        held = first_turn + 3 * frame + np.arange(3)
    return np.setdiff1d(np.arange(size), held)


def _three_coordinates(shape):
    """Three rows of d(shape)/d(turn) that are far from dependent."""
    rows = np.vstack([-crossing(p) for p in shape])
    best, chosen = 0.0, None
    for a in range(len(rows)):
        for b in range(a):
            for c in range(b):
                value = abs(np.linalg.det(rows[[a, b, c]]))
                if value > best:
                    best, chosen = value, [a, b, c]
    return np.array(chosen)


def _inverse_block(fisher, at, gauge, shape):
    kept = _kept(len(fisher), at + 3, gauge, shape)
    unit = np.zeros((len(fisher), 3))
    unit[at : at + 3] = np.eye(3)
    return unit[kept].T @ _solved(fisher[np.ix_(kept, kept)], unit[kept])


def _solved(fisher, right):
    """Solution; turns of frames with one marker or none are free and stay where they are."""
    return np.linalg.lstsq(fisher, right, rcond=1e-13)[0]


def joint_by_general_solver(points, weights, functions, start, sweeps=2):
    """Minimum of ``sum w_j |x_ij - R_i p_j - B_i a|²`` over p, a and every rotation vector, by scipy.

    ``start`` is (p, a, R). Returns (p, a, R, cost). Each sweep starts the rotation vectors anew from the last.
    """
    p, a, r = (np.array(part) for part in start)
    frames, count = points.shape[:2]
    root = np.sqrt(np.broadcast_to(weights, (frames, count)))[:, :, None]
    seen = np.isfinite(points)
    observed = np.where(seen, points, 0.0)
    scale = np.abs(p).max()
    many = functions.shape[1]

    def unpacked(z):
        p_new = z[: 3 * count].reshape(-1, 3)
        a_new = z[3 * count : 3 * count + 3 * many].reshape(-1, 3)
        turn = z[3 * count + 3 * many :].reshape(-1, 3) / scale
        return p_new, a_new, r @ Rotation.from_rotvec(turn).as_matrix()

    def difference(z):
        p_new, a_new, r_new = unpacked(z)
        model = np.einsum("fij,mj->fmi", r_new, p_new) + (functions @ a_new)[:, None, :]
        return (root * np.where(seen, observed - model, 0.0)).ravel()

    def jacobian(z):
        p_new, _, r_new = unpacked(z)
        turn = z[3 * count + 3 * many :].reshape(-1, 3) / scale
        out = np.zeros((frames, count, 3, len(z)))
        for i in range(frames):
            # exp(w + dw) = exp(w) exp(J dw) with the right Jacobian of the rotation group.
            angle = np.linalg.norm(turn[i])
            k = crossing(turn[i])
            if angle > 1e-6:
                right = np.eye(3) - (1 - np.cos(angle)) / angle**2 * k + (angle - np.sin(angle)) / angle**3 * k @ k
            else:
                right = np.eye(3) - k / 2 + k @ k / 6
            for j in range(count):
                if not seen[i, j].all():
                    continue
                out[i, j, :, 3 * j : 3 * j + 3] = -r_new[i]
                for m in range(many):
                    at = 3 * count + 3 * m
                    out[i, j, :, at : at + 3] = -functions[i, m] * np.eye(3)
                at = 3 * count + 3 * many + 3 * i
                out[i, j, :, at : at + 3] = r_new[i] @ crossing(p_new[j]) @ right / scale
                out[i, j] *= root[i, j]
        return out.reshape(-1, len(z))

    for _ in range(sweeps):
        z = np.concatenate([p.ravel(), a.ravel(), np.zeros(3 * frames)])
        found = scipy.optimize.least_squares(difference, z, jacobian, xtol=1e-13, ftol=1e-14, gtol=1e-12, max_nfev=30)
        p, a, r = unpacked(found.x)
    return p, a, r, 2.0 * found.cost
