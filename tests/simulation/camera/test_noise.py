"""The sensor's noise is Poisson plus Gauss, quantised, and knows nothing of its neighbours in space and time."""

import cv2
import numpy as np
import pytest
from bench.noise import LEVELS, NOISES, chances, draw, misfit
from scipy.stats import chi2, norm

from tipforce.simulation.rendering.camera import SensorNoise


@pytest.mark.parametrize("noise", NOISES.values())
@pytest.mark.parametrize("level", LEVELS)
def test_histogram_mean_variance_and_skewness_are_those_of_poisson_and_gauss(noise, level):
    counts = sum(np.bincount(draw(noise, level, frame).ravel(), minlength=256) for frame in range(3))
    size, grey = int(counts.sum()), np.arange(256)
    chance = chances(noise, level)
    mean = float(grey @ chance)
    central = [float((grey - mean) ** k @ chance) for k in (2, 3, 4, 6)]
    assert float(grey @ counts) / size == pytest.approx(mean, abs=5 * (central[0] / size) ** 0.5)
    off = (grey - float(grey @ counts) / size) ** 2 @ counts / size
    assert off == pytest.approx(central[0], abs=5 * ((central[2] - central[0] ** 2) / size) ** 0.5 + 1e-3 * central[0])
    third = (grey - mean) ** 3 @ counts / size
    assert third == pytest.approx(central[1], abs=5 * (central[3] / size) ** 0.5)
    # 900,000 pixels: a departure of 0.5 % of the probabilities would be seen.
    value, freedom = misfit(counts, chance)
    assert value < chi2.ppf(1 - 1e-4, freedom) + 1e-4 * size


def test_the_histogram_test_would_see_a_gaussian_in_place_of_poisson():
    noise, level = SensorNoise.at_mid_grey(5.0, read_share=0.2), 20.3
    chance, size = chances(noise, level), 921_600
    edges = norm.cdf((np.arange(255) + 0.5 - level) / noise.sigma(level))
    gauss = np.diff(np.concatenate([[0.0], edges, [1.0]]))
    common = chance * size >= 20
    misfit = ((gauss - chance)[common] ** 2 / chance[common]).sum() * size
    assert misfit > 3 * chi2.ppf(1 - 1e-4, int(common.sum()))


def test_neighbours_and_frames_are_not_correlated():
    frames = np.stack([draw(NOISES[2.0], 128.0, k)[0].astype(np.float32) for k in range(6)])
    frames = (frames - frames.mean()) / frames.std()
    limit = 5.0 / np.sqrt(frames[0].size)
    for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (0, 16), (16, 0)):
        moved = np.roll(frames[0], (dv, du), axis=(0, 1))
        assert abs(float((frames[0] * moved).mean())) < limit
    # from frame to frame, also where one is the other moved by any way
    one, two = np.fft.rfft2(frames[0]), np.fft.rfft2(frames[1])
    assert np.abs(np.fft.irfft2(one * two.conj())).max() / frames[0].size < 6.5 / np.sqrt(frames[0].size)
    pairs = np.corrcoef(frames.reshape(6, -1)) - np.eye(6)
    assert np.abs(pairs).max() < limit
    # nor do rows or columns have offsets of their own
    for axis in (1, 2):
        spread = frames.mean(axis=axis).std() * np.sqrt(frames.shape[axis])
        assert spread == pytest.approx(1.0, abs=0.12)


def test_a_colour_image_turned_grey_has_a_grey_cameras_noise():
    grey = draw(NOISES[2.0], 120.0, 3)[0]
    planes = draw(NOISES[2.0], 120.0, 3, channels=3)
    seen = cv2.cvtColor(cv2.merge(list(planes)), cv2.COLOR_RGB2GRAY)
    np.testing.assert_array_equal(grey, seen)


def test_levels_beyond_black_and_white_are_clipped():
    assert draw(NOISES[5.0], -5.0, 0).min() == 0
    assert draw(NOISES[5.0], 400.0, 0).min() == 255
