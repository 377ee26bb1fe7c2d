"""The study of error over training samples: what is trained on what, and that it goes on where it was broken off."""

import json
from typing import ClassVar

import numpy as np
import pytest
from bench.studies.learning_curve import curves, figure, study, table


@pytest.fixture
def spied(ridge_class):
    class Spied(ridge_class):
        fits: ClassVar[list] = []

        def fit(self, dataset, progress=None):
            Spied.fits.append(dataset.rows)
            return super().fit(dataset, progress)

    return Spied


def silent(_):
    pass


def test_smaller_numbers_are_parts_of_the_larger_and_the_test_part_is_never_seen(make_bench, spied, tmp_path):
    data = make_bench(sessions=4, frames=40)
    held = study(lambda _: spied(), data, [20, 40, 999], 2, tmp_path / "c.json", {"estimator": "ridge"}, silent)
    assert [len(rows) for rows in spied.fits] == [20, 40, 120] * 2
    for small, middle, whole in (spied.fits[:3], spied.fits[3:]):
        assert set(small) < set(middle) < set(whole)
    assert set(spied.fits[2]) != set(spied.fits[5])
    found = curves(held)
    assert list(found) == ["magnitude", "x", "y"]
    assert list(found["x"]) == [0, 20, 40, 120]
    assert all(len(values) == 2 for values in found["x"].values())
    assert found["x"][120].mean() < 0.5 * found["x"][0].mean()


def test_a_study_goes_on_where_it_was_broken_off(make_bench, spied, tmp_path):
    data, path = make_bench(), tmp_path / "c.json"

    def broken(seed):
        if seed == 1:
            raise KeyboardInterrupt
        return spied()

    with pytest.raises(KeyboardInterrupt):
        study(broken, data, [30], 2, path, {"estimator": "ridge"}, silent)
    first = json.loads(path.read_text(encoding="utf-8"))["fits"]
    assert len(spied.fits) == 2
    held = study(lambda _: spied(), data, [30], 2, path, {"estimator": "ridge"}, silent)
    assert len(spied.fits) == 4
    assert {key: held["fits"][key] for key in first} == first
    again = study(lambda _: spied(), data, [30, 60], 3, path, {"estimator": "ridge"}, silent)
    assert len(spied.fits) == 4 + 1 + 1 + 3
    assert json.loads(path.read_text(encoding="utf-8")) == again


def test_another_study_is_not_mixed_in(make_bench, spied, tmp_path):
    path = tmp_path / "c.json"
    study(lambda _: spied(), make_bench(), [], 1, path, {"estimator": "ridge"}, silent)
    with pytest.raises(SystemExit, match="holds another study"):
        study(lambda _: spied(), make_bench(seed=1), [], 1, path, {"estimator": "ridge"}, silent)


def test_table_and_figure_tell_mean_and_spread(make_bench, spied, tmp_path):
    held = study(lambda _: spied(), make_bench(), [30], 3, tmp_path / "c.json", {"estimator": "ridge"}, silent)
    lines = table(held)
    values = 1e3 * curves(held)["x"][30]
    assert f"{values.mean():.1f} +- {np.std(values, ddof=1):4.1f}" in lines[2]
    assert lines[1].split()[0] == "constant"
    drawn = figure(held).axes[1]
    assert drawn.lines[0].get_ydata()[0] == pytest.approx(values.mean() / 1e3)
