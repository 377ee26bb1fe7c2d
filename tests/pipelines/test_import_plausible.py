"""Logs with readings that are not the contact force: what `import_session` says, and the labels that it makes."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.alignment import Labels, labels
from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.io import RecordingReader
from tipforce.pipelines import (
    RecordingReport,
    copy_recording,
    describe_recording,
    import_session,
    plot_summary,
    record,
)
from tipforce.types import SensorInfo, SessionInfo

from ..short_run import BIAS, OFFSET_S, Run, force_readings, push  # type: ignore[import-not-found]

BENCH = SessionInfo(sensor=SensorInfo(0, "tissue-on-tip", no_contact_s=(0.0, 1.8)))


def table() -> np.ndarray:
    """(8000, 3): time, fx, fy."""
    return force_readings(1000, np.random.default_rng(1))


def imported(
    run: Run,
    folder: Path,
    rows: np.ndarray,
    status: np.ndarray | None = None,
    tare: tuple[float, float] | None = None,
    bench: SessionInfo = BENCH,
) -> tuple[RecordingReport, Labels, float]:
    """The report, the labels and their rms error in N."""
    folder.mkdir(exist_ok=True)
    log = folder / "force.csv"
    lines = [",".join("" if np.isnan(value) else f"{value:.6g}" for value in row) for row in rows]
    if status is not None:
        lines = [f"{line},{word}" for line, word in zip(lines, status.tolist(), strict=True)]
    log.write_text("\n".join(["time_s,fx_n,fy_n" + (",status" if status is not None else ""), *lines]) + "\n")
    report = import_session(
        run.video, log, folder / "run.mcap", bench=bench, offset_ms=1e3 * OFFSET_S, tare=tare or "auto"
    )
    with RecordingReader(folder / "run.mcap") as reader:
        found = labels(reader)
    error = found.force_n[:, :2] - np.outer(push(found.stamp_ns * 1e-9), [0.05, -0.2])
    return report, found, float(np.sqrt(np.nanmean(np.sum(error**2, axis=1))))


def labelled(found: Labels) -> int:
    return int((~np.isnan(found.force_n[:, 0])).sum())


def test_a_clean_log_has_no_remark_on_its_readings(run: Run, tmp_path: Path) -> None:
    report, found, rms = imported(run, tmp_path, table())
    assert report.summary.info.plausibility.lines() == []
    assert labelled(found) > 185
    assert rms < 0.005


def test_a_zero_that_was_pressed_in_mid_session_is_corrected(run: Run, tmp_path: Path) -> None:
    rows = table()
    rows[5000:, 1:] -= rows[5000, 1:]
    report, found, rms = imported(run, tmp_path, rows)
    said = "\n".join(describe_recording(report.summary))
    assert "implausible   step of the zero (5.000 s)" in said
    assert "is corrected" in said
    assert labelled(found) > 185
    assert rms < 0.006


def test_readings_with_an_error_status_give_no_labels(run: Run, tmp_path: Path) -> None:
    rows, status = table(), np.zeros(8000, np.int64)
    rows[3000:3300, 1:], status[3000:3300] = -13.0, 0x80010000
    report, found, rms = imported(run, tmp_path, rows, status)
    assert "error status: 300 readings not used (3.00-3.30 s)" in "\n".join(describe_recording(report.summary))
    assert 175 < labelled(found) < 186
    assert rms < 0.005
    figures = report.summary.figures()["plausibility"]
    assert [(each["kind"], each["readings"]) for each in figures["findings"]] == [("error status", 300)]


def test_a_status_column_of_other_meaning_can_be_left_out(run: Run, tmp_path: Path) -> None:
    status = np.ones(8000, np.int64)
    with pytest.raises(InputError, match=r'no reading that may be used.*state sensor\.log\.status = ""') as caught:
        imported(run, tmp_path, table(), status)
    assert "8000 readings" in str(caught.value)
    import_session(
        run.video, tmp_path / "force.csv", tmp_path / "run.mcap", offset_ms=40.0,
        bench=BENCH.updated(SessionInfo.from_values({"sensor": {"log": {"status": ""}}})),
    )  # fmt: skip


def test_a_clipped_axis_gives_no_labels_at_its_limit(run: Run, tmp_path: Path) -> None:
    rows = table()
    rows[:, 2] = np.maximum(rows[:, 2], BIAS[1] - 0.1)
    report, found, rms = imported(run, tmp_path, rows)
    assert "fy stays at -0.2 N, the end of its range" in "\n".join(describe_recording(report.summary))
    assert 60 < labelled(found) < 170
    assert rms < 0.005


def test_readings_at_the_stated_range_of_the_sensor_give_no_labels(run: Run, tmp_path: Path) -> None:
    """Too few to show a plateau: only the data sheet of the sensor shows that they are clipped."""
    rows = table()
    limit = float(np.sort(np.abs(rows[:, 2]))[-6])
    rows[:, 2] = np.clip(rows[:, 2], -limit, limit)
    report, _, _ = imported(run, tmp_path, rows)
    assert "clipped" not in "\n".join(describe_recording(report.summary))
    stated = replace(BENCH, sensor=replace(BENCH.sensor, range_n=(3.0, limit, 9.0)))
    report, _, _ = imported(run, tmp_path / "stated", rows, bench=stated)
    assert re.search(rf"clipped: \d+ readings not used .*{limit:.4g} N", "\n".join(describe_recording(report.summary)))


def test_spikes_and_a_gap_give_no_labels(run: Run, tmp_path: Path) -> None:
    rows = table()
    rows[[2500, 4444, 7000], 2] += 500.0
    rows[3000:3020, 1:] = rows[6000:6400, 1:] = np.nan
    report, found, rms = imported(run, tmp_path, rows)
    said = "\n".join(describe_recording(report.summary))
    assert "spike: 3 readings not used (2.500 s, 4.444 s, 7.000 s)" in said
    assert "gap: 1 of more than 50 ms (6.00-6.40 s); images in it get no force" in said
    assert "1 gap of at most 50 ms bridged" in said
    assert rms < 0.005
    at = found.stamp_ns * 1e-9 - OFFSET_S
    assert np.isnan(found.force_n[(at > 6.0) & (at < 6.399), 0]).all()
    assert labelled(found) > 170


def test_a_tare_in_contact_is_refused_with_a_stretch_that_does(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"in contact at 3 to 6 s of the force log.*for example tare=\(0, 2\)"):
        imported(run, tmp_path, table(), tare=(3.0, 6.0))
    with pytest.raises(InputError, match=r"tare=\(0, inf\): expected a stretch of time"):
        imported(run, tmp_path, table(), tare=(0.0, float("inf")))
    assert not list(tmp_path.glob("*.mcap*"))
    _, found, rms = imported(run, tmp_path, table(), tare=(0.0, 2.0))
    assert labelled(found) > 185
    assert rms < 0.006


def test_a_recording_whose_tare_was_in_contact_gets_another_one_in_a_copy(run: Run, tmp_path: Path) -> None:
    imported(run, tmp_path, table())
    bad, good = tmp_path / "recorded.mcap", tmp_path / "NEW.mcap"
    with pytest.raises(InputError, match="in contact at 3 to 6 s of the force log") as caught:
        record(RecordingReader(tmp_path / "run.mcap"), bad, tare=(3.0, 6.0), offset_ms=1e3 * OFFSET_S)
    command = re.search(r"tipforce (import \S+ -o )NEW\.mcap (--tare )0:5", str(caught.value))
    assert command is not None
    assert command[1] == f"import {bad} -o "
    words = ["import", bad, "-o", good, command[2].strip(), "0:2", "--offset-ms", 1e3 * OFFSET_S]
    assert CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False).exit_code == 0
    with RecordingReader(bad) as reader, RecordingReader(good) as other:
        assert [each.kind for each in reader.info.plausibility.findings] == ["contact during tare"]
        assert (other.info.tare.stretches_s, other.info.plausibility.findings) == (((0.0, 2.0),), ())
        assert other.info.streams == reader.info.streams
        found = labels(other)
    error = found.force_n[:, :2] - np.outer(push(found.stamp_ns * 1e-9), [0.05, -0.2])
    assert labelled(found) > 185
    assert np.sqrt(np.nanmean(np.sum(error**2, axis=1))) < 0.006
    with pytest.raises(InputError, match="was imported; import its files again with the tare"):
        copy_recording(tmp_path / "run.mcap", tmp_path / "other.mcap", tare=(0.0, 2.0))


def test_findings_are_drawn_as_stretches_of_time(run: Run, tmp_path: Path) -> None:
    rows = table()
    rows[6000:6400, 1:] = np.nan
    rows[5000:, 1:] -= rows[5000, 1:]
    report, _, _ = imported(run, tmp_path, rows)
    plot_summary(report.summary, tmp_path / "run.svg")
    drawn = (tmp_path / "run.svg").read_text()
    for kind in ("gap", "step of the zero"):
        assert f"<!-- {kind} -->" in drawn
