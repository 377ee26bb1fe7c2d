"""Published layouts: on made files everywhere, on the real ones where they are."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tipforce.datasets import open_dataset
from tipforce.errors import FileFormatError, TableError
from tipforce.types import ShapeFeatures

from ..two_view_set import write_two_view_set  # type: ignore[import-not-found]

REAL = Path(os.environ.get("TIPFORCE_REAL_DATA", ""))
needs_real = pytest.mark.skipif(
    "TIPFORCE_REAL_DATA" not in os.environ or not REAL.is_dir(),
    reason="TIPFORCE_REAL_DATA names no folder with the published measurements",
)

HEAD = "sec,nanosec,image,wire length #0,wire length #1,fx,fy,fz\n"


def write_session(folder: Path, name: str, rows: int = 12, without: int | None = None) -> None:
    folder.mkdir(exist_ok=True)
    lines = [f"7,{k * 1000},{k}.png,{k},{-k},{100 + k},{-200 - k},5\n" for k in range(rows)]
    (folder / f"data_{name}.csv").write_text(HEAD + "".join(lines))
    curves = [
        {"Image Filename": f"{k}.png", "Coefficients": [0.1, 0.2, 0.3, k]}
        for k in reversed(range(rows))
        if k != without
    ]
    (folder / f"curve_fit_result-poly4d_{name}.json").write_text(json.dumps(curves))


def test_tendon_sessions_are_tared_and_joined_with_their_curves(tmp_path: Path) -> None:
    for name in ("up", "down"):
        write_session(tmp_path / "sessions", name)
    data = open_dataset(tmp_path)
    assert data.sessions == ("down", "up")
    # the median of the first ten of 100, 101, ... is 104.5
    assert np.allclose(data.force_n[:2, :2], [[-4.5e-3, 4.5e-3], [-3.5e-3, 3.5e-3]])
    assert data.known.tolist() == [True, True, False]
    assert data.actuation["wire1_mm"][3] == -3.0
    view = next(data.subset(np.array([14])).observations()).views["camera"]
    assert isinstance(view, ShapeFeatures)
    assert view.values[3] == 2.0
    assert "millinewtons" in data.session_info["up"].remarks
    assert data.session_info["up"].force_frame == "sensor"


def test_an_incomplete_tendon_session_names_its_row(tmp_path: Path) -> None:
    write_session(tmp_path / "sessions", "up", without=5)
    with pytest.raises(TableError, match=r"data_up\.csv, row 7: curve_fit.* has no curve of the image 5\.png"):
        open_dataset(tmp_path)
    for content, said in (("[{}]", "is no list of curves"), ("[" * 100_000, "nested more than")):
        (tmp_path / "sessions" / "curve_fit_result-poly4d_up.json").write_text(content)
        with pytest.raises(FileFormatError, match=f"{said}.*; copy the data set again$"):
            open_dataset(tmp_path / "sessions")


def test_soft_arm_images_are_turned_upright(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    images = np.zeros((3, 1, 64, 64))
    images[:, 0, 2, 60] = 1.0  # column 2, row 60 as MATLAB stores it
    with h5py.File(tmp_path / "images.mat", "w") as file:
        file["input_test"] = images
    with h5py.File(tmp_path / "forces.mat", "w") as file:
        file["target_test"] = np.arange(9.0).reshape(3, 3, 1, 1)
    data = open_dataset(tmp_path)
    view = next(data.observations()).views["camera"]
    assert isinstance(view, np.ndarray)
    assert view[60, 2] == 255
    assert view.sum() == 255
    assert data.force_n[1].tolist() == [3.0, 4.0, 5.0]
    with h5py.File(tmp_path / "forces.mat", "w") as file:
        file["target_test"] = np.zeros((2, 3, 1, 1))
    with pytest.raises(FileFormatError, match=r"target_test has the shape \(2, 3, 1, 1\), expected \(3, 3, 1, 1\)"):
        open_dataset(tmp_path)


def test_sets_with_two_views_become_sessions_with_both_views_and_the_chamber_pressures(tmp_path: Path) -> None:
    for name in ("pushed", "pulled"):
        write_two_view_set(tmp_path / name)
    data = open_dataset(tmp_path)
    assert data.sessions == ("pulled", "pushed")
    first = next(data.observations())
    assert {name: np.argwhere(image).tolist() for name, image in first.views.items()} == {
        "a": [[60, 2]],
        "b": [[10, 30]],
    }
    assert np.allclose(data.actuation["chamber6_percent"], [60.0, 61.0, 62.0] * 2)
    assert data.force_n[4].tolist() == [3.0, 4.0, 5.0]
    info = data.session_info["pulled"]
    assert (info.force_frame, info.view("a").base_side, info.view("b").base_side) == ("sensor", "top", "top")
    alone = open_dataset(tmp_path / "pushed")
    assert (alone.sessions, len(alone)) == (("pushed",), 3)


def test_a_wrong_set_with_two_views_names_its_file_and_sample(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    arrays = write_two_view_set(tmp_path / "pulled")
    arrays["input_test"][1, 1, 5, 40] = 0.9
    with h5py.File(tmp_path / "pulled" / "input_test.mat", "w") as file:
        file["input_test"] = arrays["input_test"]
    with pytest.raises(
        FileFormatError, match=r"pulled/input_test\.mat: sample 1: expected the pressures .* as stripes"
    ):
        open_dataset(tmp_path)
    arrays["input_test"][2, 0, 0, 0] = np.nan
    with h5py.File(tmp_path / "pulled" / "input_test.mat", "w") as file:
        file["input_test"] = arrays["input_test"]
    with pytest.raises(FileFormatError, match=r"sample 2 of input_test holds a value that is no finite number"):
        open_dataset(tmp_path)


@needs_real
def test_the_real_sessions_have_the_published_size_and_spread() -> None:
    data = open_dataset(REAL / "tendon-manipulator")
    assert len(data) == 6283
    assert len(data.sessions) == 8
    assert np.round(np.std(data.force_n[:, :2], axis=0) * 1e3).tolist() == [199, 212]
    still = data.force_n[data.session == "nopayload", :2]
    assert np.round(np.std(still, axis=0, ddof=0) * 1e3).tolist() == [65, 54]


@needs_real
def test_the_real_images_come_with_three_components() -> None:
    pytest.importorskip("h5py")
    data = open_dataset(REAL / "soft-arm")
    assert len(data) == 641
    assert data.known.all()
    assert np.round(np.std(data.force_n, axis=0), 3).tolist() == [0.331, 0.304, 0.208]


@needs_real
def test_the_real_pairs_come_as_three_sessions_with_the_arm_at_the_top() -> None:
    pytest.importorskip("h5py")
    data = open_dataset(REAL / "soft-arm-two-views")
    assert {name: int(np.sum(data.session == name)) for name in data.sessions} == {
        "different-stuff-1": 132,
        "different-stuff-2": 107,
        "video-string": 389,
    }
    assert np.round(np.std(data.force_n, axis=0), 3).tolist() == [0.329, 0.316, 0.194]
    for name in ("a", "b"):
        images = np.array([observation.views[name] for observation in data.observations()], np.float64)
        assert images[:, :10].mean() > 3.0 * images[:, -10:].mean(), "the bright clamp is at the top"
