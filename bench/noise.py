"""``python -m bench.noise``: the simulation's cheap noise against the true distributions and NumPy's generators.

Chi-square of histograms: of the camera against Poisson plus Gauss, rounded and clipped; of the fluoroscope against
Poisson. Classes with fewer than 20 expected pixels are one.
"""

from typing import Any

import numpy as np
from bench.parts import run_alone
from bench.timing import interleaved
from scipy.stats import chi2, norm, poisson

from tipforce.simulation.rendering._random import gauss_table
from tipforce.simulation.rendering.camera import SensorNoise
from tipforce.simulation.rendering.camera._sensor_noise import add_noise, frame_key
from tipforce.simulation.rendering.fluoroscope._detector import frame_key as quantum_key
from tipforce.simulation.rendering.fluoroscope._detector import photon_tables, sample_photons

LEVELS = (3.0, 20.3, 45.0, 128.0, 199.6, 240.0)
NOISES = {sigma: SensorNoise.at_mid_grey(sigma, read_share=share) for sigma, share in ((2.0, 0.4), (5.0, 0.3))}
"""By grey levels at mid grey, as the presets draw them."""
MEANS = (0.4, 3.0, 20.0, 35.9, 36.0, 120.0, 470.0)
SHAPE = (480, 640)


def draw(noise: SensorNoise, level: float, frame: int, channels: int = 1) -> np.ndarray:
    """(channels, h, w): an even image with noise."""
    planes = np.empty((channels, *SHAPE), np.uint8)
    clean = np.full((channels, *SHAPE), level, np.float32)
    add_noise(clean, frame_key(7, frame), gauss_table(), noise.grey_per_electron, noise.read_grey, planes)
    return planes


def chances(noise: SensorNoise, level: float) -> np.ndarray:
    """(256,) exact chances of the grey levels: gain * Poisson(level / gain) + Gauss(0, read), rounded and clipped."""
    mean = level / noise.grey_per_electron
    electrons = np.arange(int(poisson.ppf(1e-12, mean)), int(poisson.ppf(1 - 1e-12, mean)) + 1)
    weight = poisson.pmf(electrons, mean)
    below = norm.cdf((np.arange(255)[:, None] + 0.5 - noise.grey_per_electron * electrons) / noise.read_grey) @ weight
    return np.diff(np.concatenate([[0.0], below, [1.0]]))


def misfit(counts: np.ndarray, chance: np.ndarray) -> tuple[float, int]:
    """Chi-square of a histogram, and its degrees of freedom."""
    size = int(counts.sum())
    common = chance * size >= 20
    want = np.append(chance[common], chance[~common].sum()) * size
    got = np.append(counts[common], counts[~common].sum())
    kept = want > 5
    return float(((got - want)[kept] ** 2 / want[kept]).sum()), int(kept.sum()) - 1


def _row(counts: np.ndarray, chance: np.ndarray) -> dict[str, float]:
    value, freedom = misfit(counts, chance)
    return {
        "pixels": int(counts.sum()),
        "chi2": value,
        "degrees of freedom": freedom,
        "99.99 % of true draws are below": float(chi2.ppf(1 - 1e-4, freedom)),
        "excess a pixel": max(0.0, value - freedom) / int(counts.sum()),
    }


def measure() -> dict[str, Any]:
    figures: dict[str, Any] = {"camera": {}, "fluoroscope": {}}
    for sigma, noise in NOISES.items():
        for level in LEVELS:
            counts = sum(np.bincount(draw(noise, level, frame).ravel(), minlength=256) for frame in range(3))
            figures["camera"][f"sigma {sigma:g}, level {level:g}"] = _row(np.asarray(counts), chances(noise, level))
    tables, photons = photon_tables(), np.empty(SHAPE, np.uint16)
    for mean in MEANS:
        counts = np.zeros(2048, np.int64)
        for frame in range(3):
            means = np.full(SHAPE, mean, np.float32)
            sample_photons(means, quantum_key(7, 0, frame, 0), tables.alias, tables.gauss, photons)
            counts += np.bincount(photons.ravel(), minlength=2048)
        figures["fluoroscope"][f"mean {mean:g}"] = _row(counts, poisson.pmf(np.arange(2048), float(np.float32(mean))))
    noise, rng = NOISES[5.0], np.random.default_rng(0)
    clean, planes = np.full((1, *SHAPE), 128.0, np.float32), np.empty((1, *SHAPE), np.uint8)
    key, table = frame_key(7, 0), gauss_table()

    def plain() -> np.ndarray:
        shot = rng.poisson(clean / noise.grey_per_electron) * noise.grey_per_electron
        return np.clip(np.rint(shot + rng.normal(0, noise.read_grey, clean.shape)), 0, 255).astype(np.uint8)

    times = interleaved(
        {
            "ours": lambda: add_noise(clean, key, table, noise.grey_per_electron, noise.read_grey, planes),
            "NumPy": plain,
        },
        10,
    )
    figures["ms for 640x480"] = {name: 1e3 * t for name, t in times.items()}
    return figures


def show(figures: dict[str, Any]) -> None:
    for device in ("camera", "fluoroscope"):
        print(f"noise of the {device}, chi-square (degrees of freedom; 99.99 % of true draws are below):")
        for name, row in figures[device].items():
            print(
                f"  {name:22} {row['chi2']:8.1f} ({row['degrees of freedom']:4d}; "
                f"{row['99.99 % of true draws are below']:7.1f}), excess {row['excess a pixel']:.1e} a pixel"
            )
    ours, plain = (figures["ms for 640x480"][name] for name in ("ours", "NumPy"))
    print(f"  640x480: {ours:.2f} ms, by NumPy's generators {plain:.1f} ms: {plain / ours:.0f} x")


if __name__ == "__main__":
    run_alone("noise", measure, show, __doc__)
