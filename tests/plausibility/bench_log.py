"""A force log of a beating contact, as a bench's logger writes it."""

import numpy as np

RATE_HZ = 1000.0
BIAS_N = np.array([0.12, -0.07, -0.33])


def bench_log(
    seconds: float = 20.0, *, rate_hz: float = RATE_HZ, noise_n: float = 3e-3, step_n: float = 5e-3, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) in ns and readings (n, 3) in N: 3 s without contact, then 1.2 beats/s with pauses between them."""
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    beat = np.maximum(0.0, np.sin(2.0 * np.pi * 1.2 * time) - 0.2 + 0.1 * np.sin(2.0 * np.pi * 0.23 * time))
    force = np.outer(np.where(time < 3.0, 0.0, beat), [0.3, -0.1, 0.01]) + BIAS_N
    force += noise_n * np.random.default_rng(seed).standard_normal(force.shape)
    stamps = np.rint(time * 1e9).astype(np.int64)
    return stamps, np.round(force / step_n) * step_n if step_n else force
