"""Method 2 whole: trained, exported, saved, loaded. Minutes on a laptop's processor."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tipforce.datasets import Dataset
from tipforce.estimators import create, load_model, save_model
from tipforce.types import Observation, SessionInfo, Status

pytestmark = pytest.mark.slow
pytest.importorskip("torch", reason="training needs the extra [train]")
pytest.importorskip("monai", reason="training needs the extra [train]")

COUNT = 160
QUICK = {"epochs": 12, "optimiser": "adamw", "rate": 0.001, "schedule": "cosine"}


class Squares:
    def __init__(self, force: np.ndarray) -> None:
        self.force = force

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            image = np.random.default_rng(row).integers(90, 110, (120, 160), dtype=np.uint8)
            x, y = self.force[row, :2]
            image[round(50 + 200 * y) : round(70 + 200 * y), round(70 + 300 * x) : round(90 + 300 * x)] = 250
            yield Observation(row, {"camera": image}, {})


def squares() -> Dataset:
    force = np.full((COUNT, 3), np.nan)
    force[:, :2] = np.random.default_rng(0).uniform(-0.2, 0.2, (COUNT, 2))
    return Dataset(
        store=Squares(force),
        session=np.repeat(["s0", "s1"], COUNT // 2),
        stamp_ns=np.arange(COUNT),
        actuation={},
        force_n=force,
        known=np.array([True, True, False]),
        names=np.array([f"{place}.png" for place in range(COUNT)]),
        session_info={name: SessionInfo(name=name) for name in ("s0", "s1")},
        rows=np.arange(COUNT),
        title="squares",
    )


@pytest.mark.parametrize("precision", ["fp32", "auto"])
def test_dcfe_learns_and_its_folder_answers_the_same(tmp_path: Path, precision: str) -> None:
    data = squares()
    part, rest = data.subset(np.arange(COUNT) % 4 > 0), data.subset(np.arange(COUNT) % 4 == 0)
    dcfe = create("dcfe", {**QUICK, "precision": precision}).fit(part)
    loaded = load_model(save_model(dcfe, tmp_path / "dcfe", part))
    found, again = (np.array([answer.force_n[:2] for answer in each.predict(rest)]) for each in (dcfe, loaded))
    assert np.array_equal(found, again, equal_nan=True)
    assert np.isfinite(found).all(axis=1).mean() > 0.9
    rms_n = float(np.sqrt(np.nanmean((found - rest.force_n[:, :2]) ** 2)))
    print(f"dcfe, {precision}: RMS {rms_n * 1e3:.1f} mN of {dcfe.describe()}")
    assert rms_n < 0.04  # 0.115 N by always answering the mean
    assert dcfe.describe().parameters == 11_177_538
    assert (tmp_path / "dcfe" / "model.onnx").stat().st_size < 46e6  # half of that in half precision
    stripes = np.tile(np.array([0, 255], np.uint8).repeat(8), (120, 10))
    strange = loaded.start(SessionInfo()).update(Observation(0, {"camera": stripes}, {}))
    assert strange.status is Status.OUT_OF_DISTRIBUTION
