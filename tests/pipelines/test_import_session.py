import re
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from tipforce.alignment import labels, observations
from tipforce.errors import FileFormatError, InputError, OutputError, TableError, TimeError, TipforceError
from tipforce.io import ClockMap, RecordingReader, RecordingWriter
from tipforce.pipelines import RecordingSummary, copy_recording, import_session, plot_summary, summarise_recording
from tipforce.types import (
    Actuation,
    ActuationInfo,
    BagInfo,
    ForceLogInfo,
    LogInfo,
    SensorInfo,
    SessionInfo,
    StageInfo,
    ViewInfo,
)

from ..io.bag_files import START_S, run_messages, write_bag  # type: ignore[import-not-found]
from ..short_run import BIAS, OFFSET_S, Run, push  # type: ignore[import-not-found]


def test_import_finds_offset_and_tare_and_yields_the_force(run: Run, tmp_path: Path) -> None:
    report = import_session(
        run.video, run.force, tmp_path / "run.mcap",
        bench=SessionInfo(sensor=SensorInfo(0, "tissue-on-tip"), actuation=ActuationInfo(constant={"knob_deg": 10.0})),
    )  # fmt: skip
    info = report.summary.info
    assert info.clock_map.how == "estimated", info.clock_map.detail
    assert info.clock_map.offset_ms == pytest.approx(1e3 * OFFSET_S, abs=8)  # a drawn line is no elastic rod
    assert info.tare.how == "detected"
    np.testing.assert_allclose(info.tare.force_n[:2], BIAS, atol=2e-3)
    assert (info.streams["camera"].count, info.streams["force"].count) == (192, 2000)
    with RecordingReader(tmp_path / "run.mcap") as reader:
        found = labels(reader)
        truth = np.outer(push(found.stamp_ns * 1e-9), [0.05, -0.2])
        inside = ~np.isnan(found.force_n[:, 0])
        assert inside.sum() > 185
        assert np.sqrt(np.mean((found.force_n[inside, :2] - truth[inside]) ** 2)) < 0.01
        assert {o.actuation["knob_deg"] for o in observations(reader)} == {10.0}
    assert not list(tmp_path.glob("*.part"))


def test_a_stated_offset_and_tare_are_taken_as_they_are(run: Run, tmp_path: Path) -> None:
    report = import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms=-12.5, tare=(0.0, 1.5))
    info = report.summary.info
    assert (info.clock_map.how, info.clock_map.offset_ns) == ("stated", -12_500_000)
    assert (info.tare.how, info.tare.stretches_s) == ("stated", ((0.0, 1.5),))
    assert info.sensor == SensorInfo(0.0, "tip-on-tissue")


def test_a_log_that_counts_from_another_zero_is_aligned_where_that_is_stated(run: Run, tmp_path: Path) -> None:
    later = tmp_path / "force.csv"
    lines = run.force.read_text().splitlines()
    moved = [f"{float(line.split(',')[0]) + 1.7e9:.3f},{line.split(',', 1)[1]}" for line in lines[1:]]
    later.write_text("\n".join([lines[0], *moved]))
    with pytest.raises(TimeError, match=r"do not overlap with video\.mp4.*offset_ms=\"start\""):
        import_session(run.video, later, tmp_path / "run.mcap", offset_ms="none")
    assert not list(tmp_path.glob("run*"))
    report = import_session(run.video, later, tmp_path / "run.mcap", offset_ms="start")
    assert report.summary.labelled > 185
    assert any("moved by -1700000000" in remark for remark in report.remarks)


def test_stamps_before_zero_move_all_streams_alike(run: Run, tmp_path: Path) -> None:
    early = tmp_path / "force.csv"
    early.write_text("time_s,fx_n,fy_n\n" + "".join(f"{k / 250 - 0.5:.3f},{k / 250},0\n" for k in range(2000)))
    import_session(
        run.video, early, tmp_path / "run.mcap", offset_ms="none", tare="none",
        bench=SessionInfo(sensor=SensorInfo(0, "tissue-on-tip")),
    )  # fmt: skip
    with RecordingReader(tmp_path / "run.mcap") as reader:
        found = labels(reader)
    inside = ~np.isnan(found.force_n[:, 0])
    assert found.stamp_ns[0] == 1_000_000_000
    np.testing.assert_allclose(found.force_n[inside, 0], found.stamp_ns[inside] * 1e-9 - 0.5, atol=1e-6)


def test_forces_that_no_catheter_bears_are_remarked_on(run: Run, tmp_path: Path) -> None:
    lines = run.force.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    large = [f"{time},{1e3 * float(x):.1f},{1e3 * float(y):.1f}" for time, x, y in rows]
    (tmp_path / "force.csv").write_text("\n".join([lines[0], *large]))
    report = import_session(run.video, tmp_path / "force.csv", tmp_path / "run.mcap", offset_ms="none")
    assert any("N: check sensor.log.force_unit" in remark for remark in report.remarks)
    usual = import_session(run.video, run.force, tmp_path / "usual.mcap", offset_ms="none")
    assert not any("force_unit" in remark for remark in usual.remarks)


def test_the_knob_may_be_a_column_or_a_log_of_its_own(run: Run, tmp_path: Path) -> None:
    table = tmp_path / "force.csv"
    table.write_text("time_s,fx_n,knob\n" + "".join(f"{k / 250:.3f},0.1,{k / 25}\n" for k in range(2000)))
    knob = tmp_path / "knob.csv"
    knob.write_text("time_s,knob_deg\n" + "".join(f"{k / 10:.1f},{k}\n" for k in range(81)))
    import_session(
        run.video,
        table,
        tmp_path / "a.mcap",
        bench=SessionInfo(actuation=ActuationInfo(knob_column="knob")),
        offset_ms="none",
    )
    import_session(run.video, [run.force, knob], tmp_path / "b.mcap", offset_ms="none")
    for name in ("a", "b"):
        with RecordingReader(tmp_path / f"{name}.mcap") as reader:
            for o in list(observations(reader))[:-3]:
                assert o.actuation["knob_deg"] == pytest.approx(o.stamp_ns * 1e-8, abs=1e-3)
    constant = SessionInfo(actuation=ActuationInfo(constant={"knob_deg": 1.0}))
    with pytest.raises(InputError, match="state one of them"):
        import_session(run.video, [knob, run.force], tmp_path / "c.mcap", bench=constant)


def test_the_knobs_column_of_a_force_log_follows_the_logs_clock(run: Run, tmp_path: Path) -> None:
    table = tmp_path / "force.csv"
    table.write_text("time_s,fx_n,knob\n" + "".join(f"{k / 250:.3f},0.1,{k / 25}\n" for k in range(2000)))
    bench = SessionInfo(actuation=ActuationInfo(knob_column="knob"))
    import_session(run.video, table, tmp_path / "run.mcap", bench=bench, offset_ms=500.0, rate=0.8, tare="none")
    with RecordingReader(tmp_path / "run.mcap") as reader:
        read = {o.stamp_ns * 1e-9: o.actuation.get("knob_deg") for o in observations(reader)}
    for seconds, knob_deg in read.items():
        if 0.6 < seconds < 6.8:
            assert knob_deg == pytest.approx(10.0 * (seconds - 0.5) / 0.8, abs=2e-3)


def test_a_moving_knob_by_a_clock_that_is_far_from_the_cameras_is_named(run: Run, tmp_path: Path) -> None:
    knob = tmp_path / "knob.csv"
    knob.write_text("time_s,knob_deg\n" + "".join(f"{k / 10:.1f},{k}\n" for k in range(81)))
    logs = {"force": run.force, "knob": knob}
    near = import_session(run.video, logs, tmp_path / "a.mcap", offset_ms=50.0)
    assert not any("is placed by the stamps" in remark for remark in near.remarks)
    far = import_session(run.video, logs, tmp_path / "b.mcap", offset_ms=50.0, rate=0.9)
    said = next(remark for remark in far.remarks if "is placed by the stamps" in remark)
    assert "knob_deg of knob.csv" in said
    assert "up to 0.75 s from the camera's" in said


def test_inertia_that_cannot_be_removed_is_refused_and_the_advice_is_good(run: Run, tmp_path: Path) -> None:
    """The contact-free stretch of the short run is too short to know the beat by."""
    rows = [line.split(",") for line in run.force.read_text().splitlines()[1:]]
    moved = [[float(value) for value in row] for row in rows]
    table = [f"{t:.3f},{x:.4f},{y + 0.03 * np.sin(2 * np.pi * 1.3 * t):.4f}" for t, x, y in moved]
    (tmp_path / "force.csv").write_text("time_s,fx_n,fy_n\n" + "\n".join(table) + "\n")

    def imported(mass_kg: float, name: str) -> RecordingSummary:
        bench = SessionInfo(sensor=SensorInfo(0.0, "tip-on-tissue", moving_mass_kg=mass_kg))
        target = tmp_path / name
        log = tmp_path / "force.csv"
        return import_session(run.video, log, target, bench=bench, offset_ms=40.0, tare=(0.0, 1.8)).summary

    with pytest.raises(
        InputError, match=r"21 mN .* inertia of the 50 g.*cannot be removed.*sensor\.moving_mass_kg = 0"
    ):
        imported(0.05, "a.mcap")
    assert not (tmp_path / "a.mcap").exists()
    assert imported(0.0, "b.mcap").labelled > 150


def test_inertia_of_a_stage_at_rest_in_the_contact_free_stretch_shows_in_the_images(run: Run, tmp_path: Path) -> None:
    def imported(mass_kg: float, metres_per_px: float | None) -> list[str]:
        views = {"camera": ViewInfo(metres_per_px)}
        bench = SessionInfo(sensor=SensorInfo(0.0, "tip-on-tissue", moving_mass_kg=mass_kg), views=views)
        target = tmp_path / "run.mcap"
        made = import_session(
            run.video, run.force, target, bench=bench, offset_ms=40.0, tare=(0.0, 1.8), overwrite=True
        )
        return [remark for remark in made.remarks if "inertia" in remark]

    with pytest.raises(InputError, match=r"inertia of the 50 g .*as the tip's acceleration in the images shows"):
        imported(0.05, 5e-4)
    (said,) = imported(0.05, 1.2e-4)
    assert "to remove it, add the stage's log" in said
    with RecordingReader(tmp_path / "run.mcap") as reader:
        assert reader.info.inertia.detail == said
    (said,) = imported(0.05, None)
    assert "how much of it the labels hold is not known" in said
    assert not imported(0.0, 5e-4)


@pytest.mark.parametrize("shift_s", [1.7e9, pytest.param(-1e3, marks=pytest.mark.slow)])
def test_a_knob_log_on_another_clock_is_refused(run: Run, tmp_path: Path, shift_s: float) -> None:
    knob = tmp_path / "knob.csv"
    knob.write_text("time_s,knob_deg\n" + "".join(f"{shift_s + k},10\n" for k in range(5)))
    with pytest.raises(TimeError, match=r"knob\.csv: its .* do not overlap with the images"):
        import_session(run.video, [run.force, knob], tmp_path / "run.mcap", offset_ms="none")
    assert not list(tmp_path.glob("run.mcap*"))


def test_images_without_a_catheter_need_a_stated_clock(run: Run, tmp_path: Path) -> None:
    import cv2

    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(60):
        cv2.imwrite(str(folder / f"{k * 100_000_000}_ns.png"), np.full((48, 64), 128, np.uint8))
    with pytest.raises(TimeError, match=r"cannot be determined: no catheter.*offset_ms=\"none\".*nothing was written"):
        import_session(folder, run.force, tmp_path / "run.mcap")
    assert not list(tmp_path.glob("run*"))
    report = import_session(folder, run.force, tmp_path / "run.mcap", offset_ms="none")
    assert report.summary.labelled == 60


def with_scaled_stamps(video: Path, scale: float, target: Path) -> Path:
    """What ``ffmpeg -itsscale scale -i video -c copy target`` writes."""
    with av.open(str(video)) as source, av.open(str(target), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None and packet.pts is not None:
                packet.pts, packet.dts = round(scale * packet.pts), round(scale * packet.dts)
                packet.stream = stream
                container.mux(packet)
    return target


def test_a_video_whose_rate_is_wrong_is_imported_with_the_rate_that_is_found(run: Run, tmp_path: Path) -> None:
    """The log runs 20 % fast against the video: as a video of 24 images a second that says 28.8."""
    lines = run.force.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    fast = [",".join([f"{1.25 * float(row[0]):.6f}", *row[1:]]) for row in rows]
    (tmp_path / "fast.csv").write_text("\n".join([lines[0], *fast]))
    report = import_session(run.video, tmp_path / "fast.csv", tmp_path / "run.mcap", tare=(0.0, 1.8))
    clock = report.summary.info.clock_map
    assert clock.rate == pytest.approx(0.8, abs=3.0 * clock.rate_stderr)
    (remark,) = [remark for remark in report.remarks if "differ in rate" in remark]
    scale = float(re.search(r"ffmpeg -itsscale (\S+) -i VIDEO -c copy", remark)[1])  # type: ignore[index]
    timed = with_scaled_stamps(run.video, scale, tmp_path / "timed.mp4")
    mended = import_session(timed, tmp_path / "fast.csv", tmp_path / "mended.mcap", tare=(0.0, 1.8)).summary
    assert mended.info.clock_map.rate == 1.0
    stated = import_session(
        run.video, tmp_path / "fast.csv", tmp_path / "stated.mcap", offset_ms=1e3 * OFFSET_S, rate=0.8, tare=(0.0, 1.8)
    )
    assert (stated.summary.info.clock_map.how, stated.summary.info.clock_map.rate) == ("stated", 0.8)
    with RecordingReader(tmp_path / "run.mcap") as found, RecordingReader(tmp_path / "stated.mcap") as right:
        apart = labels(found).force_n[:, :2] - labels(right).force_n[:, :2]
    assert np.sqrt(np.nanmean(apart**2)) < 0.01


def test_a_force_log_without_an_axis_in_the_images_plane_needs_a_stated_clock(run: Run, tmp_path: Path) -> None:
    rows = [line.split(",") for line in run.force.read_text().splitlines()]
    log = tmp_path / "force.csv"
    log.write_text("\n".join(f"{time},{y}" for time, _, y in rows) + "\n")
    with pytest.raises(TimeError, match=r"the force log has no Fx, .*State offset_ms"):
        import_session(run.video, log, tmp_path / "run.mcap", tare=(0.0, 1.5))
    stated = import_session(run.video, log, tmp_path / "run.mcap", tare=(0.0, 1.5), offset_ms=40.0)
    assert stated.summary.labelled > 150


def test_a_stated_offset_that_the_deflection_contradicts_is_said_with_both(run: Run, tmp_path: Path) -> None:
    report = import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms=-400.0, tare=(0.0, 1.5))
    said = next(remark for remark in report.remarks if "conflicts with the deflection" in remark)
    assert "-400.0 ms at a rate of 1" in said
    assert report.summary.info.clock_map.offset_ms == -400.0


def test_a_rate_that_is_no_rate_is_refused_wherever_it_is_stated(run: Run, tmp_path: Path) -> None:
    import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms="none")
    for rate in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="the true over the stated frame rate"):
            import_session(run.video, run.force, tmp_path / "other.mcap", offset_ms="none", rate=rate)
        with pytest.raises(InputError, match="the true over the stated frame rate"):
            copy_recording(tmp_path / "run.mcap", tmp_path / "copy.mcap", offset_ms="none", rate=rate)
    assert [path.name for path in tmp_path.glob("*.mcap*")] == ["run.mcap"]


def test_a_recording_of_unknown_clocks_has_labels_once_they_are_stated(run: Run, tmp_path: Path) -> None:
    import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms="none")
    with RecordingWriter(tmp_path / "unknown.mcap", SessionInfo("unknown")) as writer:
        with RecordingReader(tmp_path / "run.mcap") as reader:
            for event in reader.events():
                writer.write(event)
            assert reader.info.sensor is not None
            writer.state(reader.info.sensor)
        writer.state(ClockMap(how="refused", detail="too little motion"))
    with (
        RecordingReader(tmp_path / "unknown.mcap") as reader,
        pytest.raises(InputError, match="too little motion") as no,
    ):
        labels(reader)
    assert "tipforce import" in str(no.value)
    assert "--offset-ms MS" in str(no.value)
    copy_recording(tmp_path / "unknown.mcap", tmp_path / "stated.mcap", offset_ms=-12.0, rate=0.999)
    with RecordingReader(tmp_path / "stated.mcap") as reader:
        assert (reader.info.clock_map.offset_ms, reader.info.clock_map.rate) == (-12.0, 0.999)
        assert np.isfinite(labels(reader).force_n[:, 0]).sum() > 150


BAD: list[tuple[dict[str, Any], type[TipforceError], str]] = [
    ({"force_log": "text.csv"}, TableError, "line 3, column fy_n"),
    ({"frames": "text.csv"}, FileFormatError, "no video|no such|holds no video"),
    ({"target": "run.avi"}, InputError, "ends in .mcap"),
    ({"target": "text.csv/run.mcap"}, OutputError, "is a file, not a folder"),
    ({"frames": "stills"}, FileFormatError, "neither a table nor the names of the images say when"),
    ({"tare": (100.0, 110.0)}, InputError, "the force log runs from 0 to"),
    ({"bench": SessionInfo(sensor=SensorInfo(log=ForceLogInfo(fx="Fq")))}, TableError, "no column 'Fq'"),
]


@pytest.mark.parametrize(("change", "error", "said"), BAD)
def test_a_failed_import_leaves_nothing_behind(
    run: Run, tmp_path: Path, change: dict[str, Any], error: type[TipforceError], said: str
) -> None:
    (tmp_path / "text.csv").write_text("time_s,fx_n,fy_n\n0,1,2\n1,1,much\n")
    (tmp_path / "stills").mkdir()
    (tmp_path / "stills" / "a.png").write_bytes(b"")
    wanted: dict[str, Any] = {"frames": run.video, "force_log": run.force, "target": tmp_path / "run.mcap"}
    wanted |= {key: tmp_path / value if isinstance(value, str) else value for key, value in change.items()}
    with pytest.raises(error, match=said):
        import_session(wanted.pop("frames"), wanted.pop("force_log"), wanted.pop("target"), offset_ms="none", **wanted)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["stills", "text.csv"]


def test_an_import_that_was_killed_is_simply_run_again(run: Run, tmp_path: Path) -> None:
    """A longer leftover of an earlier import stands under the temporary name."""
    writer = RecordingWriter(tmp_path / "run.mcap", SessionInfo(), origin="import")
    for k in range(5_000):
        writer.write(Actuation(k * 1_000_000, {"a_mm": 1.0}))
    writer._halt()
    writer._mcap.flush()
    writer._stream.close()
    writer._held.close()  # a process that is killed lets go of its locks
    with pytest.raises(FileFormatError, match="run the import again"):
        RecordingReader(tmp_path / "run.mcap")
    import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms="none")
    assert summarise_recording(tmp_path / "run.mcap").info.streams["force"].count == 2000
    with pytest.raises(FileFormatError, match="exists already"):
        import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms="none")


def test_a_summary_is_drawn(run: Run, tmp_path: Path) -> None:
    report = import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms="none")
    for ending in ("png", "svg"):
        plot_summary(report.summary, tmp_path / f"run.{ending}")
        assert (tmp_path / f"run.{ending}").stat().st_size > 10_000
    figures = report.summary.figures()
    assert figures["labelled_frames"] == 192
    assert figures["clock_map"]["stderr_ms"] is None
    assert figures["streams"]["camera"]["rate_hz"] == pytest.approx(24, abs=0.1)


def test_an_offset_that_leaves_no_image_a_force_is_refused_with_both_spans(run: Run, tmp_path: Path) -> None:
    with pytest.raises(TimeError, match=r"gives a force to 0 of the 192 images .*\+1000000\.0 ms.* s of the images"):
        import_session(run.video, run.force, tmp_path / "run.mcap", offset_ms=1e6)
    assert not list(tmp_path.glob("run*"))


def test_a_log_that_covers_a_part_of_the_video_is_remarked_on(run: Run, tmp_path: Path) -> None:
    lines = run.force.read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join(lines[:301]))
    report = import_session(run.video, tmp_path / "short.csv", tmp_path / "run.mcap", offset_ms="none")
    count = report.summary.labelled
    assert 5 < count < 40
    assert any(remark.startswith(f"only {count} of 192 images have a force: ") for remark in report.remarks)
    (tmp_path / "rare.csv").write_text("\n".join([lines[0], *lines[1::25]]))
    with pytest.raises(TimeError, match=r"its readings are 0\.1 s apart, at most 0\.05 s are allowed"):
        import_session(run.video, tmp_path / "rare.csv", tmp_path / "rare.mcap", offset_ms="none", tare="none")


def test_rows_without_a_reading_leave_a_gap_and_rows_with_an_error_status_are_not_used(
    run: Run, tmp_path: Path
) -> None:
    lines = [line + ",0" for line in run.force.read_text().splitlines()]
    lines[0] = "time_s,fx_n,fy_n,status"
    for row in range(751, 754):
        lines[row] = lines[row].split(",")[0] + ",,NaN,0"
    for row in range(1251, 1326):
        lines[row] = lines[row].split(",")[0] + ",-13,13,4"
    (tmp_path / "force.csv").write_text("\n".join(lines))
    import_session(run.video, tmp_path / "force.csv", tmp_path / "run.mcap", offset_ms="none", tare=(0.0, 1.5))
    with RecordingReader(tmp_path / "run.mcap") as reader:
        found = labels(reader)
    assert 170 < np.isfinite(found.force_n[:, 0]).sum() < 190
    assert np.nanmax(np.abs(found.force_n)) < 1.0


def test_a_log_of_unclear_columns_is_the_stage_if_that_is_stated(run: Run, tmp_path: Path) -> None:
    stage = tmp_path / "position.csv"
    stage.write_text("time,x\n" + "".join(f"{k / 100},{k / 50}\n" for k in range(800)))
    columns = LogInfo(columns=("time_s", "forward_mm"))
    bench = SessionInfo(stage=StageInfo(columns))
    import_session(
        run.video, {"force": run.force, "stage": stage}, tmp_path / "run.mcap", bench=bench, offset_ms="none"
    )
    with RecordingReader(tmp_path / "run.mcap") as reader:
        readings = reader.stage_readings()
    assert len(readings) == 800
    assert readings[100][1] == {"forward_mm": 2.0}


@pytest.mark.parametrize("kind", ["bag", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("mcap", "folder"))])
def test_a_bag_is_imported_whole(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path / "made", kind, run_messages())
    bench = SessionInfo(sensor=SensorInfo(0, "tissue-on-tip"), bag=BagInfo(names={"knob_joint": "knob_deg"}))
    report = import_session(path, None, tmp_path / "run.mcap", bench=bench, offset_ms="none", tare=(0.0, 1.5))
    streams = report.summary.info.streams
    assert (streams["camera"].count, streams["force"].count, streams["joints"].count) == (192, 2000, 80)
    assert any(remark.startswith(f"{path.name}: the force is taken from") for remark in report.remarks)
    with RecordingReader(tmp_path / "run.mcap") as reader:
        found = labels(reader)
        truth = np.outer(push(found.stamp_ns * 1e-9 - START_S), [0.05, -0.2])
        inside = ~np.isnan(found.force_n[:, 0])
        assert inside.sum() > 185
        assert np.abs(found.force_n[inside, :2] - truth[inside]).max() < 2e-3
        assert {round(o.actuation["knob_deg"], 9) for o in observations(reader)} == {10.0}


def test_a_bag_may_be_the_log_of_a_video(run: Run, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "made", "db3", [each for each in run_messages() if "image" not in each.topic])
    with pytest.raises(FileFormatError, match=r"no topic of images.*`tipforce import video\.mp4 run\.db3`"):
        import_session(path, None, tmp_path / "run.mcap")
    bench = SessionInfo(bag=BagInfo(drives=()))
    report = import_session(run.video, [path], tmp_path / "run.mcap", bench=bench, offset_ms="start")
    assert report.summary.info.streams["force"].count == 2000
    assert report.summary.labelled > 185
    with pytest.raises(InputError, match="one bag is imported at a time"):
        import_session(run.video, [path, path], tmp_path / "b.mcap", bench=bench)
