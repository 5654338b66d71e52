"""Playing a map: the same as the product, in any batch, and fast."""

from __future__ import annotations

import time

import numpy as np
import pytest
from contracts.faces import face
from scipy.interpolate import RBFInterpolator
from threadpoolctl import threadpool_limits

from evalkit import EvalkitError, deformation_map
from evalkit.deform import Deformer

HEAD = face()
SITES = np.array(list(HEAD.marker_sites.values()))
MAP = deformation_map(HEAD, SITES)


def displacements(frames, centres=23):
    return np.random.default_rng(1).normal(scale=5.0, size=(frames, centres, 3))


@pytest.mark.parametrize("frames", [0, 1, 32, 33, 70])
def test_equals_the_product(frames):
    u = displacements(frames)
    expected = np.einsum("vn,fnc->fvc", MAP, u)
    # Sums of 26 products of 1e2 mm in another order.
    np.testing.assert_allclose(Deformer(MAP)(u), expected, atol=1e-11)
    np.testing.assert_allclose(Deformer(MAP, HEAD.vertices)(u), HEAD.vertices + expected, atol=1e-11)


def test_a_mesh_of_more_than_one_block():
    """Blocks of vertices and batches of frames fit together."""
    random = np.random.default_rng(3)
    weights, rest, u = random.normal(size=(12_000, 5)), random.normal(size=(12_000, 3)), displacements(40, 5)
    expected = rest + np.einsum("vn,fnc->fvc", weights, u)
    np.testing.assert_allclose(Deformer(weights, rest)(u), expected, atol=1e-11)


def test_batches_are_the_whole_and_reuse_their_buffer():
    u = displacements(100)
    play = Deformer(MAP, HEAD.vertices)
    whole = play(u)
    seen, buffers = 0, set()
    for start, positions in play.batches(u):
        np.testing.assert_array_equal(positions, whole[start : start + len(positions)])
        buffers.add(positions.__array_interface__["data"][0])
        seen += len(positions)
    assert seen == 100 and len(buffers) == 1


def test_one_frame():
    u = displacements(1)
    play = Deformer(MAP, HEAD.vertices)
    assert play(u[0]).shape == HEAD.vertices.shape
    np.testing.assert_array_equal(play(u[0]), play(u)[0])


def test_single_precision_is_good_to_a_ten_thousandth_of_a_millimetre():
    u = displacements(50)
    error = np.abs(Deformer(MAP, HEAD.vertices, np.float32)(u) - Deformer(MAP, HEAD.vertices)(u)).max()
    # 150 mm carry 8e-6 mm of rounding; the sum of 26 terms some times that.
    assert 0 < error < 1e-4


def test_a_frame_with_a_missing_marker_is_unknown_and_leaves_the_others_alone():
    u = displacements(3)
    u[1, 4] = np.nan
    out = Deformer(MAP)(u)
    assert np.isnan(out[1]).all()
    np.testing.assert_allclose(out[[0, 2]], np.einsum("vn,fnc->fvc", MAP, u[[0, 2]]), atol=1e-11)


def test_shapes_are_checked():
    with pytest.raises(EvalkitError, match=r"\(3, 22, 3\); expected \(frames, 23, 3\)"):
        Deformer(MAP)(np.zeros((3, 22, 3)))
    with pytest.raises(EvalkitError, match="rest pose has shape"):
        Deformer(MAP, np.zeros((3, 3)))
    with pytest.raises(EvalkitError, match="weights have shape"):
        Deformer(np.zeros(5))


def best(call, repeats=5):
    """Shortest time of some repeats, s: others use the machine too."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def test_one_map_is_faster_than_an_interpolator_per_frame():
    """600 frames, map and all, against scipy's interpolator fitted and evaluated in every frame."""
    u = displacements(600)

    def ours():
        play = Deformer(deformation_map(HEAD, SITES, "biharmonic", regions=False))
        for _ in play.batches(u):
            pass

    def theirs(frames):
        for x in u[:frames]:
            RBFInterpolator(SITES, x, kernel="linear", degree=1)(HEAD.vertices)

    with threadpool_limits(1):
        theirs(1)
        ratio = 150 * best(lambda: theirs(4), 3) / best(ours, 3)
    assert ratio > 20


@pytest.mark.slow
def test_share_of_the_processor_and_growth_with_the_mesh():
    """The batched product reaches 55 % of what a large square product reaches; its cost is linear in the vertices."""
    random = np.random.default_rng(2)
    square = random.normal(size=(1536, 1536)).astype(np.float32)
    out = np.empty_like(square)
    shares, costs = [], {}
    with threadpool_limits(1):
        for _ in range(5):
            peak = 2 * 1536**3 / best(lambda: np.matmul(square, square, out=out), 2)
            for vertices in (5_000, 20_000, 100_000):
                frames = 10_000_000 // vertices
                play = Deformer(random.normal(size=(vertices, 43)), dtype=np.float32)
                u = displacements(frames, 43).astype(np.float32)
                seconds = best(lambda play=play, u=u: [None for _ in play.batches(u)], 2)
                costs[vertices] = min(costs.get(vertices, np.inf), seconds / frames / vertices)
                if vertices == 5_000:
                    shares.append(2 * 43 * 3 * vertices * frames / seconds / peak)
    assert max(shares) > 0.55
    # From the second cache to memory: within a factor of two per vertex.
    assert max(costs.values()) < 2 * min(costs.values())
