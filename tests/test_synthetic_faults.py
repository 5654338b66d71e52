"""What capture systems do to a take: noise, outliers, exchanged labels, a coarse grid; levels as asked for."""

import numpy as np
import pytest

from evalkit.capture import read_capture
from evalkit.errors import EvalkitError
from evalkit.metrics import absolute_rotation_error_deg, rms
from evalkit.pose import robust, svd
from evalkit.synthetic import noise as noise_module
from evalkit.synthetic import synthesize, write_synthetic
from evalkit.synthetic.faults import CONFUSABLE_MM, neighbour_pairs
from evalkit.synthetic.noise import REACH_MM, add_noise


def noise_of(frames, seed=7, **changes):
    """Noise alone: a noisy take minus the same one without noise, shape (F, M, 3), and the truth."""
    silent, _ = synthesize("clean", seed=seed, frames=frames, **changes)
    noisy, truth = synthesize("clean", seed=seed, frames=frames, noise=0.3, **changes)
    return noisy.points - silent.points, truth


def autocorrelation(noise, lag):
    return float((noise[lag:] * noise[:-lag]).mean() / (noise**2).mean())


def test_noise_in_time_has_the_stated_level_and_correlation():
    frames, steps = 8000, 6.0
    noise, _ = noise_of(frames, noise_time_s=steps / 60.0)
    a = np.exp(-1 / steps)
    count = noise.size * (1 - a**2) / (1 + a**2)  # samples of white noise with the same error of their variance
    assert noise.std() == pytest.approx(0.3, rel=4 / np.sqrt(2 * count))
    for lag in (1, 6, 18):
        assert autocorrelation(noise, lag) == pytest.approx(a**lag, abs=4 / np.sqrt(count)), lag
    # The mean over all frames is as uncertain as that of (1 - a) / (1 + a) as many samples; 69 coordinates.
    spread = noise.mean(axis=0).std() / (0.3 * np.sqrt((1 + a) / (1 - a) / frames))
    assert spread == pytest.approx(1.0, abs=4 / np.sqrt(2 * 69))
    white, _ = noise_of(frames)  # control
    assert abs(autocorrelation(white, 1)) < 0.01
    assert white.mean(axis=0).std() < 0.5 * noise.mean(axis=0).std()


def test_noise_in_time_is_stationary_from_the_first_frame():
    noise = np.zeros((4, 5000, 3))
    add_noise(noise, 1.0, seed=1, steps=20.0)
    # 15,000 draws: the standard error of a standard deviation is 0.006.
    np.testing.assert_allclose(noise.std(axis=(1, 2)), 1.0, atol=4 * 0.006)


def test_noise_does_not_depend_on_the_blocks_it_is_made_in(monkeypatch):
    sites = np.random.default_rng(0).normal(scale=40.0, size=(9, 3))
    whole, pieces = np.zeros((50, 9, 3)), np.zeros((50, 9, 3))
    add_noise(whole, 1.0, seed=1, steps=5.0, shared=0.4, sites=sites)
    monkeypatch.setattr(noise_module, "BLOCK", 7)
    add_noise(pieces, 1.0, seed=1, steps=5.0, shared=0.4, sites=sites)
    np.testing.assert_allclose(pieces, whole, rtol=0, atol=1e-12)


def test_shared_noise_is_that_of_neighbours():
    frames, share = 6000, 0.6
    noise, truth = noise_of(frames, layout="dense-63", noise_shared=share)
    markers = len(truth.labels)
    flat = noise.transpose(0, 2, 1).reshape(-1, markers)
    observed = np.corrcoef(flat.T)
    sites = truth.neutral
    weights = np.array([[np.exp(-(np.linalg.norm(p - q) ** 2) / REACH_MM**2) for q in sites] for p in sites])
    weights = np.array([row / np.linalg.norm(row) for row in weights])
    expected = share * weights @ weights.T + (1 - share) * np.eye(markers)
    # 18,000 draws: 0.0075 is the standard error of a correlation of 0, and the largest of 1,953 lies at some 3.5.
    assert np.abs(observed - expected).max() < 5 * 0.0075
    np.testing.assert_allclose(flat.std(axis=0), 0.3, rtol=5 / np.sqrt(2 * len(flat)))
    distance = np.sqrt(((sites[:, None] - sites) ** 2).sum(axis=2))
    assert observed[(distance > 0) & (distance < 12)].min() > 0.4
    assert abs(observed[distance > 120].mean()) < 0.02
    alone, _ = noise_of(frames, layout="dense-63")  # control
    flat = alone.transpose(0, 2, 1).reshape(-1, markers)
    assert np.abs(np.corrcoef(flat.T) - np.eye(markers)).max() < 5 * 0.0075


def outliers_of(**changes):
    """True displacement of every sample, shape (F, M, 3), and the truth."""
    clean, _ = synthesize("clean", seed=4, frames=8000)
    take, truth = synthesize("clean", seed=4, frames=8000, **changes)
    return take.points - clean.points, truth


def test_outliers_have_the_stated_share_and_size_and_no_other_sample_moves():
    moved, truth = outliers_of(outliers=0.05, outlier_mm=40.0, gaps=0.1)
    assert not (truth.outliers & ~truth.visible).any()
    assert not moved[truth.visible & ~truth.outliers].any()
    size = np.linalg.norm(moved[truth.outliers], axis=1)
    # 184,000 samples, half of the outliers in some 300 bursts of 15: 4 standard errors are a sixth.
    assert truth.outliers.sum() / truth.visible.sum() == pytest.approx(0.05, rel=1 / 6)
    assert 20.0 - 1e-9 < size.min() < 20.5
    assert 59.5 < size.max() < 60.0 + 1e-9
    directions = moved[truth.outliers & ~np.roll(truth.outliers, 1, axis=0)]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.abs(directions.mean(axis=0)).max() < 4 / np.sqrt(3 * len(directions))


def test_outliers_are_ghosts_in_bursts_and_spikes_alone():
    moved, truth = outliers_of(outliers=0.05, outlier_bursts=1.0, outlier_length=20)
    inside = truth.outliers[1:] & truth.outliers[:-1]
    np.testing.assert_allclose(moved[1:][inside], moved[:-1][inside], atol=1e-9)
    starts = (truth.outliers & ~np.roll(truth.outliers, 1, axis=0)).sum()
    # Some 460 runs of geometric length: 4 standard errors are 19 %.
    assert truth.outliers.sum() / starts == pytest.approx(20, rel=0.19)
    moved, spikes = outliers_of(outliers=0.05, outlier_bursts=0.0)
    starts = (spikes.outliers & ~np.roll(spikes.outliers, 1, axis=0)).sum()
    assert spikes.outliers.sum() / starts == pytest.approx(1 / 0.95, rel=0.02)


def test_swapped_samples_are_the_partners_true_path():
    take, truth = synthesize("label-swaps", seed=5, noise=0.0, frames=3000, swaps=0.1, swap_length=30)
    path = np.einsum("fij,fmj->fmi", truth.rotations, truth.clean) + truth.translations[:, None]
    expected = np.take_along_axis(path, truth.identity[..., None], axis=1)
    np.testing.assert_allclose(take.points, expected, rtol=0, atol=1e-9)
    assert (np.sort(truth.identity, axis=1) == np.arange(63)).all()  # nobody is lost or doubled
    off = np.linalg.norm(take.points - path, axis=2)
    assert (off[truth.swapped] > 1.0).all()
    assert off[~truth.swapped].max() < 1e-9
    pairs = neighbour_pairs(truth.neutral)
    paired = np.unique(pairs)
    assert len(paired) == 2 * len(pairs) < 63
    assert max(np.linalg.norm(truth.neutral[a] - truth.neutral[b]) for a, b in pairs) <= CONFUSABLE_MM
    assert not np.delete(truth.swapped, paired, axis=1).any()
    # 29 pairs of 3,000 frames are some 290 runs of 30: 4 standard errors are a third.
    assert truth.swapped[:, paired].mean() == pytest.approx(0.1, rel=1 / 3)


def test_swaps_leave_gaps_and_noise_by_label():
    plain, _ = synthesize("talking", seed=6, gaps=0.1, frames=300)
    take, truth = synthesize("talking", seed=6, gaps=0.1, frames=300, swaps=0.3)
    assert np.array_equal(take.visible, plain.visible)
    assert np.array_equal(take.visible, truth.visible)
    assert truth.swapped.any()
    assert not (truth.swapped & ~truth.visible).any()
    same = truth.visible & ~truth.swapped
    np.testing.assert_array_equal(take.points[same], plain.points[same])


def test_quantised_coordinates_lie_on_the_grid(tmp_path):
    step = 0.1
    take, truth = synthesize("quantised", seed=7, noise=1.0, gaps=0.05)
    fine, _ = synthesize("quantised", seed=7, noise=1.0, gaps=0.05, quantum_mm=0.0)
    seen = truth.visible
    steps = take.points[seen] / step
    np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-9)
    assert np.abs(fine.points[seen] / step - np.rint(fine.points[seen] / step)).max() > 0.49  # control
    error = take.points[seen] - fine.points[seen]
    assert np.abs(error).max() <= step / 2 + 1e-9
    # Uniform rounding error; 39,000 coordinates: 4 standard errors of its level are below 1 %.
    assert error.std() == pytest.approx(step / np.sqrt(12), rel=0.01)
    read = read_capture(write_synthetic("quantised", tmp_path, frames=30).capture)
    # The file's 32 bits carry the grid to 0.0001 mm.
    assert np.abs(read.points / step - np.rint(read.points / step)).max() * step < 1.3e-4


def test_a_grid_that_integers_cannot_hold_is_one_clear_line():
    with pytest.raises(
        EvalkitError, match=r"quantum_mm = 0.01 holds coordinates of up to 328 mm .* use 0.05\d* or"
    ) as e:
        synthesize("clean", quantum_mm=0.01, frames=20)
    assert "\n" not in str(e.value)
    enough = float(str(e.value).split("use ")[1].split()[0])
    take, _ = synthesize("clean", quantum_mm=enough, frames=20)
    assert np.abs(take.points / enough).max() < 32_767


@pytest.mark.parametrize("fault", ["outliers", "label-swaps"])
def test_robust_pose_withstands_what_least_squares_does_not(fault):
    take, truth = synthesize(fault, seed=8, frames=1200)
    rigid = [truth.labels.index(label) for label in truth.rigid]
    sound = ~(truth.outliers | truth.swapped)[:, rigid]
    spoilt = (sound.sum(axis=1) < 7) & (sound.sum(axis=1) > 4)
    assert 50 < spoilt.sum() < 600
    template, points = truth.neutral[rigid], take.points[:, rigid]

    def error_deg(pose, frames):
        assert pose.ok[frames].all()
        return rms(absolute_rotation_error_deg(pose.rotations, truth.rotations)[frames])

    told = svd(template, points, sound.astype(float))
    # The best there is: least squares that is told which markers are sound. All faults are 14 mm and more, 40 times
    # the noise, so hardly a frame is misjudged; one of 100 that is off by as much as least squares costs 5 %.
    assert error_deg(robust(template, points), spoilt) < 1.1 * error_deg(told, spoilt)
    assert error_deg(svd(template, points), spoilt) > 2.0 * error_deg(told, spoilt)
    whole = sound.all(axis=1)  # control: without faults there is no difference between the three
    np.testing.assert_allclose(error_deg(robust(template, points), whole), error_deg(told, whole), rtol=0.02)
    np.testing.assert_allclose(error_deg(svd(template, points), whole), error_deg(told, whole), rtol=1e-9)


@pytest.mark.parametrize("fault", ["noise_time_s", "noise_shared", "quantum_mm", "outliers", "swaps"])
def test_least_squares_is_exact_exactly_where_theory_says(fault):
    # Correlated noise of level 0 is none; every other fault displaces points and must show in the pose.
    value = {"noise_time_s": 0.2, "noise_shared": 0.5, "quantum_mm": 0.1, "outliers": 0.05, "swaps": 0.4}[fault]
    take, truth = synthesize("clean", seed=9, frames=300, layout="dense-63", **{fault: value})
    rigid = [truth.labels.index(label) for label in truth.rigid]
    error = np.abs(svd(truth.neutral[rigid], take.points[:, rigid]).rotations - truth.rotations).max()
    assert (error < 1e-11) == fault.startswith("noise")


def test_faults_have_streams_of_their_own():
    plain, truth = synthesize("talking", seed=11, frames=200)
    changes = {
        "outliers": (0.1, {"outliers"}),
        "swaps": (0.2, {"identity"}),
        "gaps": (0.2, {"visible"}),
        "neck_gap_mm": (40.0, {"sway", "translations", "nod_centre"}),
        "asymmetry": (0.5, {"expression"}),
        "profile": ("held", {"rotations", "translations"}),
        "noise_time_s": (0.2, set()),
        "noise_shared": (0.5, set()),
        "quantum_mm": (0.5, set()),
    }
    parts = ("rotations", "translations", "pivot", "sway", "neutral", "expression", "visible", "outliers", "identity")
    for name, (value, affected) in changes.items():
        take, other = synthesize("talking", seed=11, frames=200, **{name: value})
        assert not np.array_equal(take.points, plain.points), name
        for part in (*parts, "nod_centre"):
            same = np.array_equal(getattr(truth, part), getattr(other, part))
            assert same == (part not in affected), (name, part)
    both, two = synthesize("talking", seed=11, frames=200, outliers=0.1, gaps=0.2)
    one, lone = synthesize("talking", seed=11, frames=200, outliers=0.1)
    np.testing.assert_array_equal(both.points[two.visible], one.points[two.visible])
    assert np.array_equal(two.outliers, lone.outliers & two.visible)


@pytest.mark.parametrize(
    ("overrides", "text"),
    [
        ({"profile": "walking"}, "profile 'walking' is not one of talk, held, shaking, reading"),
        ({"outliers": 0.6}, "outliers = 0.6 is not a number from 0 to 0.5"),
        ({"swap_length": 2.5}, "swap_length = 2.5 is not a whole number"),
        ({"asymmetry": -2}, "asymmetry = -2 is not a number from -1 to 1"),
        ({"noise_time": 1}, "did you mean 'noise_time_s'"),
    ],
)
def test_mistakes_are_one_clear_line(overrides, text):
    with pytest.raises(EvalkitError) as caught:
        synthesize("talking", **overrides)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
