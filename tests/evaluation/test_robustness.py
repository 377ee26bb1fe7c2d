"""Robustness: tables of errors under perturbations, of a method that reads nothing but the mean of an image."""

import numpy as np
import pytest

from tipforce.datasets import PERTURBATIONS, Light, Perturbation
from tipforce.errors import InputError
from tipforce.evaluation import EvaluationSettings, Method, evaluate, report_lines, write_report
from tipforce.evaluation._protocols import ScoredData
from tipforce.evaluation._robustness import perturbed_metrics
from tipforce.evaluation.report._figures_extra import figure_perturbed
from tipforce.types import ForceEstimate, Status


@pytest.fixture(scope="module")
def bright(make_bench):
    """Sessions whose images are as bright as the force is large: a disc on black, away from the borders."""

    def make(sessions=3, frames=40):
        data = make_bench(sessions=sessions, frames=frames, shift_n=0.0, noise_n=0.001)
        views = []
        for size in data.magnitude_n:
            view = np.zeros((120, 160), np.uint8)
            view[50:70, 70:90] = np.rint(400 * size)
            views.append(view)
        return make_bench(sessions=sessions, frames=frames, shift_n=0.0, noise_n=0.001, views=views)

    return make


@pytest.fixture(scope="module")
def mean_class(ridge_class):
    class Stream:
        def __init__(self, model):
            self.model, self.seen = model, 0

        def update(self, observation):
            self.seen += 1
            value = float(observation.views["camera"].mean())
            if value > self.model.settings.refuse_above_deg:
                return ForceEstimate.invalid(observation.stamp_ns, Status.OUT_OF_DISTRIBUTION, "too bright")
            xy = self.model.weights_ * value
            half = 3 * self.model.sigma_
            size = float(np.hypot(*xy))
            return ForceEstimate(
                stamp_ns=observation.stamp_ns,
                force_n=np.array([*xy, np.nan]),
                known=np.array([True, True, False]),
                covariance_n2=np.full((3, 3), np.nan),
                interval_n=np.array([[xy[0] - half, xy[0] + half], [xy[1] - half, xy[1] + half], [np.nan] * 2]),
                magnitude_n=size,
                magnitude_interval_n=np.array([size - half, size + half]),
                detail=f"frame {self.seen}",
            )

    class ImageMean(ridge_class):
        name = "mean"

        def fit(self, dataset, progress=None):
            means = np.array([seen.views["camera"].mean() for seen in dataset.observations()])
            known = dataset.force_n[:, :2]
            self.weights_ = means @ known / (means @ means)
            self.sigma_ = float((known - means[:, None] * self.weights_).std())
            return self

        def calibrate(self, dataset, progress=None):
            return self

        def start(self, info):
            return Stream(self)

    return ImageMean


@pytest.fixture(scope="module")
def result(bright, mean_class):
    return evaluate(
        bright(), [Method("mean", mean_class())], EvaluationSettings(protocols=["session"], perturbed_frames=60)
    )


def line_of(lines, kind, size):
    return next(line for line in lines if (line["kind"], line["size"]) == (kind, size))


def test_the_first_line_is_the_unperturbed_error_on_the_same_samples(bright, mean_class):
    result = evaluate(
        bright(), [Method("mean", mean_class())], EvaluationSettings(protocols=["session"], perturbed_frames=10**6)
    )
    first, *rest = result.perturbed["mean"]
    row, constant = result.result("mean", "session"), result.result("constant", "session")
    assert first["kind"] == "unperturbed"
    assert first["mae_n"] == pytest.approx(row.mae_n)
    assert first["rmse_x_n"] == pytest.approx(row.metrics["quantities"]["x"]["rmse_n"])
    assert first["coverage"] == pytest.approx(row.metrics["quantities"]["magnitude"]["coverage"])
    assert first["constant"]["mae_n"] == pytest.approx(constant.mae_n)
    assert [(line["kind"], line["size"]) for line in rest] == list(
        dict.fromkeys((each.kind, each.size) for each in PERTURBATIONS)
    )


def test_a_method_is_hurt_by_what_it_cannot_tell_apart_and_by_nothing_else(result):
    lines = result.perturbed["mean"]
    plain = lines[0]["mae_n"]
    assert plain < 0.01
    for kind, size in (("shift", "20 px"), ("turn", "15°"), ("blur", "2 px")):
        assert line_of(lines, kind, size)["mae_n"] == pytest.approx(plain, abs=2e-3)
    mean = np.mean([r.predictions.reference_magnitude_n.mean() for r in result.results[:1]])
    assert line_of(lines, "light", "× 0.6")["mae_n"] == pytest.approx(0.4 * mean, rel=0.1)
    assert line_of(lines, "zoom", "× 1.25")["mae_n"] == pytest.approx((1.25**2 - 1) * mean, rel=0.1)
    assert line_of(lines, "light", "× 0.6")["coverage"] < 0.5 < lines[0]["coverage"]


def test_a_force_turned_along_moves_the_components_of_method_and_constant_and_not_the_magnitude(result):
    lines = result.perturbed["mean"]
    stays, along = line_of(lines, "turn", "45°"), line_of(lines, "turn, force turned along", "45°")
    assert along["mae_n"] == pytest.approx(stays["mae_n"])
    assert along["rmse_y_n"] > 5 * stays["rmse_y_n"]
    assert along["constant"]["rmse_y_n"] > stays["constant"]["rmse_y_n"]


def test_each_way_stands_by_itself_too(result):
    shift = line_of(result.perturbed["mean"], "shift", "10 px")
    assert [each["way"] for each in shift["ways"]] == ["right", "left", "down", "up"]
    assert shift["samples"] == sum(each["samples"] for each in shift["ways"]) == 240
    assert shift["mae_n"] == pytest.approx(np.mean([each["mae_n"] for each in shift["ways"]]))


def test_the_share_abstained_is_given(bright, mean_class, make_ridge):
    settings = make_ridge(refuse_above_deg=3.0).settings
    result = evaluate(
        bright(), [Method("mean", mean_class(settings))], EvaluationSettings(protocols=["session"], perturbed_frames=60)
    )
    lines = result.perturbed["mean"]
    assert 0 < lines[0]["abstained_share"] < line_of(lines, "light", "× 1.4")["abstained_share"] < 1
    assert line_of(lines, "light", "× 0.6")["abstained_share"] < lines[0]["abstained_share"]


def test_the_same_seed_gives_the_same_table(bright, mean_class, result):
    again = evaluate(
        bright(), [Method("mean", mean_class())], EvaluationSettings(protocols=["session"], perturbed_frames=60)
    )
    assert again.perturbed == result.perturbed


def test_a_method_that_remembers_is_shown_frames_in_a_row(bright, mean_class, make_ridge):
    seen = []

    class Watched(mean_class):
        def predict(self, dataset):
            seen.append(dataset.rows.tolist())
            return super().predict(dataset)

    data = bright(sessions=2, frames=80)
    method = Method("mean", Watched(make_ridge(uses_history=True).settings))
    result = evaluate(data, [method], EvaluationSettings(protocols=["session"], every=4))
    row, constant = result.result("mean", "session"), result.result("constant", "session")
    seen.clear()
    scored = ScoredData(result.dataset, data, result.dataset.magnitude_n > 0.01)
    dark = Perturbation("light", "dark", Light(0.5))
    first, _ = perturbed_metrics(method, row, constant, scored, frames=100, perturbations=[dark])
    whole = len(row.predictions)
    assert 0.9 * whole < first["samples"] <= whole, "ten stretches show nearly all of two short sessions, and once"
    for rows in seen:
        assert rows == list(range(rows[0], rows[0] + len(rows)))
        assert len(rows) <= 50


def test_a_saved_model_is_perturbed_as_saved(bright, mean_class):
    data = bright()
    saved = mean_class().fit(data.subset(data.session == "s0"))
    saved.weights_ = 2 * saved.weights_
    method = Method("mean", saved.unfitted(), saved, frozenset({"s0"}))
    result = evaluate(data, [method], EvaluationSettings(protocols=["random"], perturbed_frames=30))
    first = result.perturbed["mean"][0]
    assert first["mae_n"] == pytest.approx(result.result("mean", "as saved").mae_n, rel=0.2)
    assert first["mae_n"] > 10 * result.result("mean", "random").mae_n
    assert first["samples"] == 30
    alone = evaluate(data, [method], EvaluationSettings(as_saved=True, perturbed_frames=30))
    assert alone.perturbed["mean"][0]["mae_n"] == first["mae_n"]
    assert alone.perturbed["mean"][0]["constant"]["mae_n"] == pytest.approx(alone.results[1].mae_n, rel=0.2)


def test_data_without_images_are_refused_before_the_work(make_bench, ridge_class):
    class Never(ridge_class):
        def fit(self, dataset, progress=None):
            raise AssertionError("trained")

    with pytest.raises(InputError, match="no image in the samples of bench of numbers"):
        evaluate(make_bench(), [Method("ridge", Never())], EvaluationSettings(perturbed_frames=10))


def test_the_report_shows_table_and_figure(result, tmp_path, no_method_figures):
    figures = write_report(result, tmp_path / "r")
    page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    assert "Under perturbations" in page
    assert "turn, force turned along" in page
    assert (tmp_path / "r" / "figures" / "perturbed.svg").is_file()
    assert figures["perturbed"]["mean"][0]["kind"] == "unperturbed"
    said = next(line for line in report_lines(figures) if line.startswith("mean, perturbed"))
    assert "turn 45°" in said
    assert "a constant" in said


def test_a_method_that_always_abstains_gets_its_table_and_figure(
    bright, mean_class, make_ridge, tmp_path, no_method_figures
):
    mute = mean_class(make_ridge(refuse_above_deg=-1.0).settings)
    result = evaluate(bright(), [Method("mute", mute)], EvaluationSettings(protocols=["session"], perturbed_frames=10))
    figures = write_report(result, tmp_path / "r")
    assert {line["abstained_share"] for line in figures["perturbed"]["mute"]} == {1.0}
    assert {line["mae_n"] for line in figures["perturbed"]["mute"]} == {None}


def test_an_error_off_the_scale_is_written_as_a_number(result):
    lines = [dict(line, mae_n=0.03) for line in result.perturbed["mean"]]
    line_of(lines, "blur", "4 px")["mae_n"] = 1.234
    drawn = figure_perturbed({"mean": lines})
    assert [text.get_text() for axes in drawn.axes for text in axes.texts] == ["1234 mN"]
    assert drawn.axes[0].get_ylim()[1] < 4 * lines[0]["constant"]["mae_n"]
