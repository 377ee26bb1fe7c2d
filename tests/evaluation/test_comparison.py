"""Methods side by side over the load: figures that can be recomputed, and the page and the terminal that show them."""

import numpy as np
import pytest

from tipforce.evaluation import (
    LOAD_BINS_N,
    SENSOR_MAE_N,
    EvaluationSettings,
    Method,
    comparison,
    evaluate,
    report_lines,
    summary,
    write_report,
)
from tipforce.units import grams_to_newtons


@pytest.fixture(scope="module")
def compared(make_bench, make_ridge):
    methods = [Method("ridge", make_ridge()), Method("careful", make_ridge(refuse_above_deg=30))]
    settings = EvaluationSettings(protocols=["session"], compare=True)
    return evaluate(make_bench(sessions=4, frames=60), methods, settings)


def test_rows_are_those_of_the_strictest_protocol_with_the_constant_last(compared) -> None:
    found = comparison(compared)
    assert found["protocol"] == "session"
    assert [row["method"] for row in found["rows"]] == ["ridge", "careful", "constant"]
    for row in found["rows"]:
        predictions = compared.result(row["method"], "session").predictions
        error = (predictions.magnitude_n - predictions.reference_magnitude_n)[predictions.valid]
        assert row["mae_n"] == pytest.approx(np.abs(error).mean())
        assert row["bias_n"] == pytest.approx(error.mean())
        assert row["abstained_share"] == pytest.approx(1 - len(error) / len(predictions))
    assert found["rows"][0]["update_us"] > 0
    assert found["rows"][2]["update_us"] is None


def test_bins_of_the_load_hold_the_samples_in_them(compared) -> None:
    row = comparison(compared)["rows"][0]
    predictions = compared.result("ridge", "session").predictions
    size = predictions.reference_magnitude_n
    assert len(row["by_load"]) > 4
    for part in row["by_load"]:
        inside = (size >= part["from_n"]) & (size < part["below_n"])
        assert part["samples"] == inside.sum() >= 10
        assert part["mae_n"] == pytest.approx(np.abs(predictions.magnitude_n - size)[inside].mean())
        assert {part["from_n"], part["below_n"]} < set(LOAD_BINS_N)


def test_sensors_in_the_tip_are_as_published() -> None:
    assert SENSOR_MAE_N["TactiCath"] == pytest.approx(grams_to_newtons(1.19))
    assert max(SENSOR_MAE_N, key=lambda name: SENSOR_MAE_N[name]) == "AcQBlate"


def test_the_page_and_the_terminal_show_it_when_asked(compared, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tipforce.evaluation.report._html.method_drawings", lambda *_: [])
    monkeypatch.setattr(type(compared.methods[0].estimator), "breaks", "It breaks beyond 35 degrees.")
    metrics = write_report(compared, tmp_path / "report", "tipforce evaluate --compare ridge")
    lines = report_lines(metrics)
    place = lines.index("Methods side by side:")
    assert " ".join(lines[place + 1].split()).startswith("MAE mN RMSE max bias Fx MAE Fy MAE R2 coverage %")
    assert any(line.startswith("TactiCath, sensor in the tip") for line in lines)
    assert "ridge: It breaks beyond 35 degrees." in lines
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert 'id="comparison"' in page
    assert (tmp_path / "report" / "figures" / "comparison.svg").is_file()


def test_it_is_left_out_unless_asked_for(make_bench, make_ridge) -> None:
    plain = evaluate(make_bench(), [Method("ridge", make_ridge())], EvaluationSettings(protocols=["session"]))
    metrics = summary(plain)
    assert metrics["comparison"] is None
    assert "Methods side by side:" not in report_lines(metrics)
