"""The learning curve of a method that carries the log of its training."""

import json

import numpy as np
import pytest

from tipforce.errors import ModelError
from tipforce.evaluation import EvaluationSettings, Method, evaluate, write_report
from tipforce.evaluation.report._figures_extra import figure_training, kept_epoch, training_log


def rows_of(errors_n):
    return [
        {"epoch": k + 1, "loss": 2 * e, "training_error_n": 0.8 * e, "validation_error_n": e, "seconds": 1.0 + k}
        for k, e in enumerate(errors_n)
    ]


@pytest.fixture
def logged_class(ridge_class):
    class Logged(ridge_class):
        log = b""

        def fit(self, dataset, progress=None):
            errors = 0.2 / np.arange(1, 31) + 0.02 + 1e-4 * len(dataset)
            self.log = "".join(json.dumps(row) + "\n" for row in rows_of(errors.tolist())).encode()
            return super().fit(dataset, progress)

        def files(self):
            return {"model.onnx": b"not read", "training.jsonl": self.log}

    return Logged


@pytest.mark.slow
def test_the_report_shows_the_learning_curve_of_a_method_that_keeps_a_log(
    make_bench, logged_class, tmp_path, no_head_figures
):
    settings = EvaluationSettings(protocols=["session"])
    result = evaluate(make_bench(sessions=3), [Method("net", logged_class())], settings)
    write_report(result, tmp_path / "r")
    assert (tmp_path / "r" / "figures" / "net-training.svg").is_file()
    page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    assert "Learning curve of the split “sessions never seen: without s0”" in page
    assert "kept: epoch 30" in page
    saved = logged_class().fit(make_bench())
    saved.log = json.dumps(rows_of([0.1, 0.3])[0]).encode()
    result = evaluate(make_bench(), [Method("net", saved.unfitted(), saved)], EvaluationSettings(protocols=["random"]))
    write_report(result, tmp_path / "r")
    assert "Learning curve of the saved model" in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")


def test_a_method_without_a_log_has_no_curve(make_bench, make_ridge):
    assert training_log(make_ridge().fit(make_bench())) == []


def test_an_error_that_was_no_number_is_a_gap(make_bench, logged_class):
    fitted = logged_class().fit(make_bench())
    fitted.log = (
        b'{"epoch": 1, "training_error_n": 0.2, "validation_error_n": null}\n'
        + json.dumps({"epoch": 2, "training_error_n": 0.1, "validation_error_n": 0.15}).encode()
    )
    rows = training_log(fitted)
    assert np.isnan(rows[0]["validation_error_n"])
    assert kept_epoch(rows)["epoch"] == 2


def test_the_kept_epoch_is_the_first_with_the_smallest_validation_error():
    rows = rows_of([0.3, float("nan"), 0.1, 0.2, 0.1])
    assert kept_epoch(rows)["epoch"] == 3
    axes = figure_training(rows, "net").axes[0]
    training, validation, kept = axes.lines
    assert training.get_ydata()[0] == pytest.approx(240)
    assert validation.get_ydata()[2] == pytest.approx(100)
    assert (kept.get_xdata()[0], kept.get_ydata()[0]) == (3, pytest.approx(100))


@pytest.mark.parametrize(
    "log", [b"{", b'{"epoch": 1}', b'{"epoch": 1, "training_error_n": "?", "validation_error_n": 1}']
)
def test_a_log_that_cannot_be_read_is_told(make_bench, logged_class, log):
    fitted = logged_class().fit(make_bench())
    fitted.log = log
    with pytest.raises(ModelError, match=r"ridge: its training\.jsonl cannot be read"):
        training_log(fitted)
