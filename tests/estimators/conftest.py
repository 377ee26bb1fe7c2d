"""A small world with a known law: shape numbers and a knob -> two force components, in sessions."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tipforce.dataset import Dataset, open_dataset


@pytest.fixture
def world(tmp_path: Path) -> Callable[..., Dataset]:
    """A dataset of ready-made polynomials: ``sessions`` x ``frames``, noise in newtons, 30 Hz."""

    def make(
        sessions: int = 4, frames: int = 40, noise_n: float = 0.005, spread_n: float = 0.0, seed: int = 0
    ) -> Dataset:
        draw = np.random.default_rng(seed)
        folder = tmp_path / f"world-{sessions}-{frames}-{noise_n}-{spread_n}-{seed}"
        folder.mkdir(exist_ok=True)
        lines = ["shape_A1,shape_A2,shape_A3,shape_A4,shape_A5,session,stamp_ns,knob_deg,fx_n,fy_n"]
        for session in range(sessions):
            offset = draw.normal(0, spread_n, 2)
            phase = draw.uniform(0, 6)
            for frame in range(frames):
                push = 0.15 + 0.1 * np.sin(0.3 * frame + phase)
                side = 0.08 * np.cos(0.17 * frame + phase)
                knob = 10.0 + session % 3
                shape = [push - 0.02 * knob, 0.5 * side + push**2, side, 0.1 * knob + side * push, 0.0]
                shape = [value + draw.normal(0, 1e-4) * (place < 4) for place, value in enumerate(shape)]
                force = np.array([-push, side]) + offset + draw.normal(0, noise_n, 2)
                cells = [*shape, f"s{session}", frame * 33_333_333, knob, *force]
                lines.append(",".join(str(cell) for cell in cells))
        (folder / "metadata.csv").write_text("\n".join(lines) + "\n")
        return open_dataset(folder)

    return make
