import base64
import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.evaluation import (
    EvaluationSettings,
    Method,
    evaluate,
    report_lines,
    summary,
    truth_at,
    verdict,
    write_report,
)
from tipforce.evaluation.report._gallery import worst_frames
from tipforce.types import BasePose, CentrelinePx, ShapeFeatures, Status
from tipforce.vision import DetectedShape, VisionSettings


@pytest.fixture(scope="module")
def report(make_bench, make_ridge, tmp_path_factory):
    """A report of two methods on four sessions, one of which refuses, with truth."""
    data = make_bench(sessions=4, frames=60)
    methods = [Method("ridge", make_ridge()), Method("<b>careful</b>", make_ridge(refuse_above_deg=30))]
    truth = np.nan_to_num(data.force_n)
    result = evaluate(data, methods, EvaluationSettings(seed=3), truth_n=truth)
    folder = tmp_path_factory.mktemp("report") / "out"
    figures = write_report(result, folder, "tipforce evaluate ridge --data <runs> -o out")
    return result, folder, figures


def test_the_page_needs_nothing_from_outside(report):
    page = (report[1] / "report.html").read_text(encoding="utf-8")
    for attribute in re.findall(r'(?:src|href|xlink:href|action|data)\s*=\s*"([^"]*)"', page):
        assert attribute.startswith(("data:", "#")), attribute
    for target in re.findall(r"url\(([^)]*)\)", page):
        assert target.strip("'\"").startswith(("data:", "#")), target
    assert "@import" not in page
    assert "<script" not in page
    assert "<link" not in page.replace('<link rel="icon" href="data:,">', "")


def test_the_page_begins_with_the_verdict_in_grams_and_newtons(report):
    page = (report[1] / "report.html").read_text(encoding="utf-8")
    first = re.search(r'<p class="verdict">(.*?)</p>', page, re.S).group(1)
    assert re.search(r"On sessions never seen, ridge: MAE [\d.]+ g \(\d+ mN\); random split: .* a constant: ", first)
    assert "Research use only" in page


def test_text_from_files_is_escaped(report):
    page = (report[1] / "report.html").read_text(encoding="utf-8")
    assert "<b>careful</b>" not in page
    assert "&lt;b&gt;careful&lt;/b&gt;" in page
    assert "--data &lt;runs&gt;" in page


def test_metrics_are_json_without_nan_and_hold_every_row(report):
    result, folder, figures = report

    def refuse(constant):
        raise AssertionError(f"{constant} in metrics.json")

    stored = json.loads((folder / "metrics.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert stored == figures
    assert [(row["method"], row["protocol"]) for row in stored["results"]] == [
        (r.method, r.protocol) for r in result.results
    ]
    assert stored["results"][0]["against_sensor"]["quantities"]["magnitude"]["mae_n"] == pytest.approx(
        result.results[0].mae_n
    )
    assert stored["results"][0]["against_truth"]["quantities"]["magnitude"]["mae_n"] > 0
    assert stored["seed"] == 3
    assert stored["data"]["fingerprint"] == result.everything.fingerprint()


def test_every_figure_is_a_drawing_of_its_own_too(report):
    names = {path.stem for path in (report[1] / "figures").iterdir()}
    kinds = ("fig23a", "fig23b", "fig24", "fig31", "fig32", "residuals", "trace", "sessions")
    head = {"trace", "scatter", "bland-altman", "coverage-force", "retention", "splits"}
    assert names == {
        *head,
        "-b-careful--b--bland-altman",
        *(f"{m}-{kind}" for m in ("ridge", "-b-careful--b-") for kind in kinds),
    }
    for path in (report[1] / "figures").iterdir():
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
        assert root.tag.endswith("svg")
        assert len(list(root.iter())) > 50


def test_drawings_on_the_page_are_described_and_none_is_shown_with_type_below_12_px(report):
    page = (report[1] / "report.html").read_text(encoding="utf-8")
    drawings = re.findall(r"<figure id[^>]*--least: (\d+)px[^>]*>\s*(<svg .*?</svg>)", page, re.S)
    assert len(drawings) >= 13
    for least, drawing in drawings:
        assert 'aria-label="' in drawing
        assert float(re.search(r'viewBox="0 0 ([\d.]+)', drawing).group(1)) <= int(least) + 1
        sizes = [float(size) for size in re.findall(r"font(?:-size)?: ?(?:[a-z0-9]+ )?([\d.]+)px", drawing)]
        assert sizes
        assert min(sizes) >= 12


def test_the_page_leads_with_trace_and_scatter_then_results_agreement_and_coverage(report):
    page = (report[1] / "report.html").read_text(encoding="utf-8")
    marks = ('class="verdict"', 'id="trace"', 'id="scatter"', "Results by protocol", 'id="bland-altman"')
    marks += ('id="coverage-force"', 'id="more"', 'id="ridge-fig23a"')
    places = [page.index(mark) for mark in marks]
    assert places == sorted(places)
    trace = (report[1] / "figures" / "trace.svg").read_text(encoding="utf-8")
    assert "&lt; 0.1 N" in trace
    assert "&gt; 0.4 N" in trace


def test_a_table_for_each_protocol_gives_confidence_intervals_or_says_why_not(report, make_bench, make_ridge):
    few = (report[1] / "report.html").read_text(encoding="utf-8")
    results = few[few.index('id="scores"') : few.index('id="agreement"')]
    assert results.count("<table>") == 3
    assert results.count("4 sessions: too few") == 9
    assert any("4 sessions are too few" in sentence for sentence in report[2]["verdict"])
    data = make_bench(sessions=6)
    result = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["session"]))
    figures = summary(result)
    magnitude = figures["results"][0]["against_sensor"]["quantities"]["magnitude"]
    low, high = magnitude["mae_ci95_n"]
    assert low < magnitude["mae_n"] < high
    assert any("over 6 sessions: " in sentence for sentence in figures["verdict"])


def test_a_report_replaces_an_older_one_whole(make_bench, make_ridge, tmp_path, no_figures):
    folder = tmp_path / "report"
    result = evaluate(make_bench(sessions=2), [Method("first", make_ridge())], EvaluationSettings(protocols=["random"]))
    write_report(result, folder)
    result = evaluate(
        make_bench(sessions=2), [Method("second", make_ridge())], EvaluationSettings(protocols=["random"])
    )
    write_report(result, folder)
    assert not list((folder / "figures").glob("first*"))
    assert list((folder / "figures").glob("second*"))
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_a_folder_with_something_else_in_it_is_left_alone(report, tmp_path):
    (tmp_path / "thesis.docx").write_text("years of work")
    with pytest.raises(InputError, match=r"thesis\.docx"):
        write_report(report[0], tmp_path)
    assert (tmp_path / "thesis.docx").read_text() == "years of work"


def test_a_report_that_fails_leaves_nothing_behind(report, tmp_path, monkeypatch, no_figures):
    folder = tmp_path / "report"
    folder.mkdir()
    (folder / "metrics.json").write_text("the last one")
    before = (folder / "metrics.json").read_bytes()

    def fail(*_args):
        raise OSError("disk full")

    monkeypatch.setattr("tipforce.evaluation.report._html._fill", fail)
    with pytest.raises(OSError, match="disk full"):
        write_report(report[0], folder)
    assert (folder / "metrics.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_a_method_that_reads_nothing_is_called_no_better_than_a_constant(make_bench, make_ridge):
    data = make_bench()
    data.actuation["bend_deg"][:] = 1.0
    lines = verdict(evaluate(data, [Method("blind", make_ridge(alpha=1.0))]))
    assert any("no better than" in line for line in lines)


def test_a_method_that_never_answers_still_gets_a_report(make_bench, make_ridge, tmp_path):
    result = evaluate(make_bench(), [Method("mute", make_ridge(refuse_above_deg=-1000))])
    figures = write_report(result, tmp_path / "report")
    assert "gave no estimate" in figures["verdict"][0]
    assert "out of distribution" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert report_lines(figures)


@pytest.mark.slow
def test_unbounded_intervals_are_shown_as_what_they_are(make_bench, make_ridge, tmp_path):
    result = evaluate(
        make_bench(), [Method("vague", make_ridge(unbounded=True))], EvaluationSettings(protocols=["session"])
    )
    figures = write_report(result, tmp_path / "report")
    magnitude = figures["results"][0]["against_sensor"]["quantities"]["magnitude"]
    assert any("exclude nothing" in sentence for sentence in figures["verdict"])
    assert (magnitude["coverage"], magnitude["width_n"], magnitude["unbounded_share"]) == (1.0, None, 1.0)


def test_refusing_the_hard_samples_does_not_win(make_bench, make_ridge):
    result = evaluate(make_bench(), [Method("careful", make_ridge(refuse_above_deg=12)), Method("brave", make_ridge())])
    assert summary(result)["best_method"] == "brave"


def test_without_held_out_sessions_the_verdict_says_so(make_bench, make_ridge):
    result = evaluate(make_bench(sessions=1), [Method("ridge", make_ridge())])
    lines = verdict(result)
    assert lines[0].startswith("On blocks of time held out")
    assert any("No session was held out" in line for line in lines)


def test_the_gallery_draws_the_curve_of_ready_made_coefficients(make_bench, make_ridge, tmp_path, no_figures):
    draw = np.random.default_rng(1)
    names = ("A1", "A2", "A3", "A4")
    views = [ShapeFeatures(names, draw.normal(0, 0.2, 4)) for _ in range(120)]
    result = evaluate(make_bench(sessions=3, views=views), [Method("ridge", make_ridge())])
    write_report(result, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert page.count('aria-label="shape of ') == 8


def test_the_gallery_shows_the_worst_frames_with_what_was_seen(make_bench, ridge_class, tmp_path):
    class Detecting(ridge_class):
        def predict(self, dataset, progress=None):
            points = np.column_stack([np.linspace(0, 60, 16), np.full(16, 24.0)])
            base = BasePose(np.array([0.0, 24.0]), 0.0)
            shape = DetectedShape(Status.VALID, "", CentrelinePx(points), base, 6.0, 1.0)
            return [replace(estimate, shape=shape) for estimate in super().predict(dataset, progress)]

    views = [np.full((48, 64), 200, np.uint8) for _ in range(120)]
    result = evaluate(make_bench(sessions=3, views=views), [Method("detecting", Detecting())])
    cards = worst_frames(result, "detecting", worst=5)
    outcome = result.result("detecting", "session").predictions
    error = dict(zip(outcome.names, np.abs(outcome.magnitude_n - outcome.reference_magnitude_n), strict=True))
    names = [card.name for card in cards]
    assert names[0] == max(error, key=error.get)
    assert [error[name] for name in names] == sorted((error[name] for name in names), reverse=True)
    stamps = [(card.session, outcome.stamp_ns[outcome.names.tolist().index(card.name)]) for card in cards]
    assert all(abs(s - t) > 1e9 for i, (a, s) in enumerate(stamps) for b, t in stamps[:i] if a == b)
    assert all(card.image_uri.startswith("data:image/jpeg;base64,") for card in cards)
    bare = worst_frames(evaluate(make_bench(sessions=3, views=views), [Method("bare", ridge_class())]), "bare", worst=1)
    assert bare[0].image_uri != cards[0].image_uri


def test_of_several_views_the_gallery_shows_the_one_that_the_method_looks_at(make_bench, ridge_class):
    class TwoViews:
        def __init__(self, store):
            self.store = store

        def read(self, rows):
            for each in self.store.read(rows):
                yield replace(each, views={"a": np.zeros((48, 64), np.uint8), "b": np.full((48, 64), 200, np.uint8)})

    class DetectingSettings(type(ridge_class().settings)):
        vision: VisionSettings = VisionSettings(view="b")

    class LooksAtB(ridge_class):
        views = ("b",)

        def __init__(self, settings=None):
            super().__init__(settings or DetectingSettings())

    data = make_bench(sessions=3)
    names = np.char.add(data.names, " of b")
    data = replace(data, store=TwoViews(data.store), view_names={"a": data.names, "b": names})
    cards = {}
    for method in (LooksAtB(), ridge_class()):
        cards[type(method)] = worst_frames(evaluate(data, [Method("m", method)]), "m", worst=1)[0]
    brightness = {
        kind: cv2.imdecode(np.frombuffer(base64.b64decode(card.image_uri.partition(",")[2]), np.uint8), 0).mean()
        for kind, card in cards.items()
    }
    assert brightness[LooksAtB] > 190
    assert brightness[ridge_class] < 10
    assert cards[LooksAtB].name.endswith(".png of b")
    assert cards[ridge_class].name.endswith(".png")


def test_the_table_of_samples_shows_what_the_method_is_fed(make_bench, ridge_class):
    class Showing(ridge_class):
        def normalised(self, dataset):
            bend = dataset.actuation["bend_deg"] / 50
            return ("bend",), bend[:, None], ("force",), dataset.magnitude_n[:, None] / 0.5

    figures = summary(evaluate(make_bench(), [Method("ridge", Showing())], EvaluationSettings(protocols=["random"])))
    table = figures["methods"]["ridge"]["samples_table"]
    assert table["names"] == ["bend", "force"]
    forces = [row[-1] for row in table["rows"]]
    assert len(forces) == 5
    assert forces == sorted(forces, reverse=True)


def test_truth_is_found_by_session_and_stamp(make_bench):
    data = make_bench(sessions=2, frames=4)
    first = data.stamp_ns[4:6]
    stamps = np.array([*(first + 4_000), 340_000_000])
    force = np.arange(9.0).reshape(3, 3)
    found = truth_at(data, {"s1": (stamps, force), "elsewhere": (stamps, force)})
    assert np.isnan(found[:4]).all()
    assert found[4].tolist() == [0.0, 1.0, 2.0]
    assert found[5].tolist() == [3.0, 4.0, 5.0]
    assert np.isnan(found[6:]).all()


def test_truth_of_other_data_is_refused(make_bench):
    with pytest.raises(InputError, match=r"no sample of bench of numbers has a truth"):
        truth_at(make_bench(), {"elsewhere": (np.array([0]), np.zeros((1, 3)))})


def test_truth_of_another_session_of_the_same_name_is_refused(make_bench):
    data = make_bench(sessions=1, frames=6)
    jitter = np.array([2.2, -1.8, 0.4, -2.9, 3.3, -1.2])
    beside = data.stamp_ns + (1e6 * jitter).astype(np.int64)
    with pytest.raises(InputError, match=r"truth of s0 belongs to another recording .* 2.0 ms from"):
        truth_at(data, {"s0": (beside, np.zeros((6, 3)))})


def test_the_lines_for_the_terminal_name_every_row(report):
    text = "\n".join(report_lines(report[2]))
    assert text.startswith("On sessions never seen")
    assert text.count("constant predictor") == 4, "two protocols and, under the stricter one, trust"
    assert "sessions never seen:" in text


def test_the_page_and_the_terminal_say_how_far_answers_can_be_trusted(report):
    _, folder, figures = report
    page = (folder / "report.html").read_text(encoding="utf-8")
    section = re.search(r'<section id="trust">(.*?)</section>', page, re.S).group(1)
    assert "off by more than 50 mN" in section
    assert "60 to 180° to the shaft" in section, "these forces pull"
    strict = next(row for row in figures["results"] if row["protocol"] == figures["strictest_protocol"])
    trust = strict["against_truth"]["trust"]
    assert f"<td>{trust['by_force'][0]['samples']}{'*' if trust['by_force'][0]['few'] else ''}</td>" in section
    lines = report_lines(figures)
    start = next(place for place, line in enumerate(lines) if line.startswith("Trust, against the truth"))
    assert lines[start + 1].split()[:4] == ["wrong", "%", "area", "mN"]
    assert [line.split()[0] for line in lines[start + 2 : start + 5]] == ["ridge", "<b>careful</b>", "constant"]
