"""Example-based facial rigging: blendshapes whose mixtures meet the examples, and that else stay as the rough ones are.

H. Li, T. Weise, M. Pauly, "Example-based facial rigging", SIGGRAPH 2010, doi:10.1145/1778765.1778769.
"""

from __future__ import annotations

import numpy as np

from evalkit.geometry import Array
from evalkit.transfer.gradients import Indices, deformation_gradients, mesh_size
from evalkit.transfer.solver import MeshSolver

ROUNDS = 10
"""Alternations between blendshapes and weights."""

SHAPE_PRIOR = (0.5, 0.1)
"""Weight of the rough blendshapes' gradients, in the first and the last round (beta of the paper)."""

WEIGHT_PRIOR = (1.0, 0.1)
"""Weight of the prior of the mixtures, in the first and the last round, over the mean squared size of the blendshapes,
which makes gamma of the paper a number without a unit."""

KAPPA, THETA = 0.1, 2.0
"""Of the weight ``((1 + |M|) / (kappa + |M|))^theta`` by which triangles that a rough shape hardly moves are held."""

STILL = 1e-4
"""Vertices that nothing moves by more than this share of the mesh's diagonal are pinned."""


def example_based_rig(rest: Array, triangles: Indices, rough: Array, fine: Array, new: Array) -> Array:
    """Fine shapes for new rough ones, after Li et al.

    The blendshapes are the rough examples and the new rough shapes together; every fine example is a mixture of them,
    its own one with weight one to begin with. In turn, the blendshapes' gradients are fitted to the fine examples with
    the rough ones as prior, and the mixtures to the blendshapes. New shapes change where mixtures use them.

    Parameters
    ----------
    rest : ndarray, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    rough, fine : ndarray, shape (M, V, 3)
    new : ndarray, shape (N, V, 3)

    Returns
    -------
    ndarray, shape (N, V, 3)
    """
    shapes = np.concatenate([rough, new])
    reach = np.linalg.norm(np.concatenate([shapes, fine]) - rest, axis=2).max(axis=0)
    solver = MeshSolver(rest, triangles, reach <= STILL * mesh_size(rest))
    prior, goal = (_gradient_moves(rest, s, triangles) for s in (shapes, fine))
    size = np.sqrt((prior**2).sum(axis=1))
    looseness = ((KAPPA + size) / (1.0 + size)) ** THETA
    start = np.eye(len(rough), len(shapes))
    mixtures, moves = start, shapes - rest
    for step in np.linspace(0.0, 1.0, ROUNDS):
        beta, gamma = (b[0] * (b[1] / b[0]) ** step for b in (SHAPE_PRIOR, WEIGHT_PRIOR))
        gradients = _shapes_step(mixtures, goal, prior, looseness / beta)
        wanted = gradients.reshape(len(shapes), 3, 3, -1).transpose(1, 2, 0, 3) + np.eye(3)[:, :, None, None]
        moves = solver.solve(wanted, rest + moves) - rest
        mixtures = _mixtures_step(start, moves, fine - rest, gamma)
    return np.asarray(rest + moves[len(rough) :])


def _gradient_moves(rest: Array, shapes: Array, triangles: Indices) -> Array:
    """Deformation gradients less the identity, (N, 9, T)."""
    off = deformation_gradients(rest, shapes, triangles) - np.eye(3)[:, :, None, None]
    return np.ascontiguousarray(off.reshape(9, len(shapes), -1).swapaxes(0, 1))


def _shapes_step(mixtures: Array, goal: Array, prior: Array, looseness: Array) -> Array:
    """Minimum of ``sum_k |goal_k - sum_i a_ki X_i|^2 + sum_i |X_i - prior_i|^2 / looseness_i`` for every triangle.

    By the matrix inversion lemma the system has the size of the examples, not of the blendshapes.
    """
    spread = mixtures[:, :, None] * looseness
    inner = np.einsum("kit,ji->tkj", spread, mixtures) + np.eye(len(mixtures))
    off = goal - np.tensordot(mixtures, prior, axes=1)
    pull = np.linalg.solve(inner, off.transpose(2, 0, 1)).transpose(1, 2, 0)
    return np.asarray(prior + np.einsum("kit,kdt->idt", spread, pull))


def _mixtures_step(start: Array, moves: Array, goal: Array, gamma: float) -> Array:
    """Minimum of ``|goal_k - sum_i a_ki moves_i|^2 + gamma s |a_k - start_k|^2`` with a between zero and one.

    s is the mean squared size of the blendshapes that move.
    """
    from scipy.optimize import lsq_linear

    flat = moves.reshape(len(moves), -1)
    gram = flat @ flat.T
    weight = gamma * np.trace(gram) / len(gram)
    if not weight > 0.0:
        return start
    lower = np.linalg.cholesky(gram + weight * np.eye(len(gram)))
    right = flat @ goal.reshape(len(goal), -1).T + weight * start.T
    goals = np.linalg.solve(lower, right)
    return np.array([lsq_linear(lower.T, one, bounds=(0.0, 1.0)).x for one in goals.T])
