"""The thesis's chapter 4 in a report: table 5 and figures 30, 31 and 32, of methods that answer components."""

import base64
import re

import cv2
import numpy as np
import pytest

from tipforce.evaluation import EvaluationSettings, Method, evaluate, write_report
from tipforce.evaluation.report._figures_thesis import figure_31, figure_32, sample_sheet


@pytest.fixture(scope="module")
def images(make_bench):
    """Grey images that grow brighter from sample to sample."""
    views = [np.full((48, 64), 60 + i, np.uint8) for i in range(120)]
    return make_bench(sessions=3, views=views)


@pytest.fixture(scope="module")
def report(images, make_ridge, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "out"
    result = evaluate(images, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["random"]))
    return result, write_report(result, folder), folder


def test_table_5_tells_the_errors_by_direction_beside_the_thesis(report):
    result, figures, folder = report
    page = (folder / "report.html").read_text(encoding="utf-8")
    table = page[page.index("(thesis table 5)") :]
    table = table[: table.index("</table>")]
    rows = [re.findall(r"<t[hd][^>]*>([^<]*)</t[hd]>", row) for row in re.findall(r"<tr.*?</tr>", table, re.S)[1:]]
    outcome = result.result("ridge", "random").predictions
    for axis, name in enumerate("xy"):
        size = np.abs(outcome.force_n[:, axis] - outcome.reference_n[:, axis])
        assert rows[axis][1] == name
        assert float(rows[axis][2]) == pytest.approx(size.min(), abs=6e-5)
        assert float(rows[axis][3]) == pytest.approx(size.max(), abs=6e-4)
        assert float(rows[axis][4]) == pytest.approx(np.sqrt(np.mean(size**2)), abs=6e-4)
    assert rows[2][1:] == ["x", "0.0001", "0.066", "0.028", "154"]
    assert rows[3][1:] == ["y", "0.0003", "0.068", "0.023", "154"]
    assert {path.stem for path in (folder / "figures").iterdir()} >= {"ridge-fig30", "ridge-fig31", "ridge-fig32"}
    assert figures["thesis"]["by_direction"]["y"]["rmse_n"] == 0.023


def test_figure_30_shows_twelve_images_of_the_test_part(report, images):
    result, _, folder = report
    outcome = result.result("ridge", "random").predictions
    svg = (folder / "figures" / "ridge-fig30.svg").read_text(encoding="utf-8")
    data = base64.b64decode(re.search(r'href="data:image/jpeg;base64,([^"]+)"', svg).group(1))
    shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    middles = shown[112::229, 150::304]
    assert middles.shape == (3, 4)
    held_out = 60 + images.rows[outcome.index]
    wanted = held_out[np.linspace(0, len(outcome) - 1, 12).round().astype(int)]
    assert middles.ravel() == pytest.approx(wanted, abs=2)


def test_figure_31_boxes_hold_what_was_measured_and_estimated(report):
    outcome = report[0].result("ridge", "random").predictions
    left, right, *_ = figure_31(outcome).axes
    for axes, axis in ((left, 0), (right, 1)):
        flat = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) and not np.ptp(line.get_ydata())]
        medians = [values[0] for values in flat]
        for values in (outcome.reference_n[:, axis], outcome.force_n[:, axis]):
            assert min(abs(median - np.median(values)) for median in medians) < 1e-9
    assert [tick.get_text().split()[0] for tick in left.get_xticklabels()] == ["rx", "px"]


def test_figure_32_draws_every_test_sample(report):
    outcome = report[0].result("ridge", "random").predictions
    top, bottom, *_ = figure_32(outcome).axes
    for axes, axis in ((top, 0), (bottom, 1)):
        measured, estimated = axes.lines
        assert measured.get_ydata().tolist() == outcome.reference_n[:, axis].tolist()
        assert estimated.get_ydata().tolist() == outcome.force_n[:, axis].tolist()


def test_without_images_there_is_no_contact_sheet_of_them(make_bench, make_ridge):
    data = make_bench(sessions=2)
    row = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["random"])).results[0]
    assert sample_sheet(data, row.predictions, "camera") is None
