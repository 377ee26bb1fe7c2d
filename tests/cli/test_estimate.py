"""``tipforce estimate``: a row per frame, and never a number that is not one."""

import csv
import io
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import av
import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app, main
from tipforce.cli._facts import stated_info
from tipforce.errors import InputError
from tipforce.estimators import Estimator
from tipforce.io import RecordingWriter, open_source, write_video
from tipforce.pipelines import COLUMNS, estimate, write_estimates
from tipforce.types import STAGE, Actuation, ActuationInfo, Catheter, ForceEstimate, Frame, Image, SessionInfo

from .conftest import bend_at, draw_image  # type: ignore[import-not-found]

KNOB = {"knob_deg": 10.0}


def run(*words: object) -> object:
    return CliRunner().invoke(app, ["estimate", *map(str, words)], catch_exceptions=False)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def written(model: Path, video: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    result = run(
        model, video, "--knob-deg", 10, "-o", folder / "f.csv", "--overlay", folder / "o.mp4", "--json", folder / "j"
    )
    assert result.exit_code == 0, result.output
    return folder


def test_there_is_a_row_for_every_frame_with_its_stamp(written: Path) -> None:
    rows = rows_of(written / "f.csv")
    assert tuple(rows[0]) == COLUMNS
    np.testing.assert_allclose([int(row["stamp_ns"]) for row in rows], np.arange(20) * 40_000_000, atol=20_000)


def test_a_row_names_its_image_file(model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for number in (1, 2, 10):
        cv2.imwrite(str(folder / f"image{number}.png"), draw_image(0.5))
    with pytest.warns(UserWarning, match="in the order of the numbers in their names"):
        result = run(model, folder, "--knob-deg", 10, "-o", tmp_path / "f.csv")
    assert result.exit_code == 0, result.output
    assert [row["file_name"] for row in rows_of(tmp_path / "f.csv")] == ["image1.png", "image2.png", "image10.png"]


def test_the_force_is_the_one_that_bent_the_tube(written: Path, true_n: list[float]) -> None:
    for true, row in zip(true_n, rows_of(written / "f.csv"), strict=True):
        if row["status"] == "valid":
            assert float(row["magnitude_n"]) == pytest.approx(true, abs=0.02)
            assert float(row["magnitude_low_n"]) <= float(row["magnitude_n"]) <= float(row["magnitude_high_n"])
            assert float(row["magnitude_g"]) == pytest.approx(float(row["magnitude_n"]) / 9.80665e-3, abs=2e-3)
            assert float(row["fy_low_n"]) <= float(row["fy_n"]) <= float(row["fy_high_n"])
            assert float(row["magnitude_n"]) == pytest.approx(
                np.hypot(float(row["fx_n"]), float(row["fy_n"])), abs=1e-5
            )


def test_cells_are_empty_where_nothing_is_known(written: Path) -> None:
    rows = rows_of(written / "f.csv")
    for place, row in enumerate(rows):
        assert row["fz_n"] == row["fz_low_n"] == row["fz_high_n"] == "", "a planar method knows nothing of z"
        if place in (8, 9):
            assert row["status"] == "no_catheter"
            assert row["detail"]
            assert all(row[name] == "" for name in COLUMNS if name.endswith(("_n", "_g")))
        else:
            assert row["status"] == "valid"


def test_the_overlay_plays_in_a_browser_and_shows_what_happened(written: Path) -> None:
    with av.open(str(written / "o.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        stamps, frames = zip(*((f.time, f.to_ndarray(format="rgb24")) for f in container.decode(stream)), strict=True)
    np.testing.assert_allclose(np.diff(stamps), 0.04, atol=1e-3)
    top = [frame[:20].reshape(-1, 3).mean(axis=0) for frame in frames]
    red = [bool(r > 120 and g < 90) for r, g, _ in top]
    assert red == [place in (8, 9) for place in range(20)]


def test_figures_count_what_was_refused(written: Path) -> None:
    figures = json.loads((written / "j").read_text())
    assert figures["frames"] == 20
    assert figures["statuses"] == {"valid": 18, "no_catheter": 2}
    assert figures["magnitude_n"]["min"] < figures["magnitude_n"]["mean"] < figures["magnitude_n"]["max"]


def test_window_limit_and_integral_are_told(written: Path, model: Path, video: Path, tmp_path: Path) -> None:
    rows = rows_of(written / "f.csv")
    last = rows[-1]
    clinical = json.loads((written / "j").read_text())["clinical"]
    assert float(last["unknown_s"]) == pytest.approx(0.08, abs=2e-3), "two frames of 40 ms, not zero newtons"
    assert clinical["unknown_s"] == pytest.approx(0.08, abs=2e-3)
    forces = [float(row["magnitude_n"]) if row["magnitude_n"] else np.nan for row in rows]
    weights = 0.04 * np.array([0.5, *[1.0] * 18, 0.5])
    assert float(last["integral_g_s"]) == pytest.approx(np.nansum(weights * forces) / 9.80665e-3, rel=0.01)
    assert float(last["integral_low_g_s"]) < float(last["integral_g_s"]) < float(last["integral_high_g_s"])
    assert {rows[8]["contact_state"], rows[8]["above_limit"]} == {"unknown", ""}
    result = run(model, video, "--knob-deg", 10, "-o", tmp_path / "f.csv", "--set", "limit_n=0.2")
    assert "above 0.2 N: " in result.output
    assert "unknown: 0.1 s of 0.8 s" in result.output
    assert "force-time integral: " in result.output


def test_the_table_can_go_to_standard_output(model: Path, video: Path) -> None:
    result = run(model, video, "--knob-deg", 10, "-o", "-")
    assert result.stdout.splitlines()[0] == ",".join(COLUMNS)
    assert len(result.stdout.splitlines()) == 21
    assert "18 with a force" in result.stderr


def test_without_the_knob_nothing_is_begun_and_the_option_is_named(
    model: Path, video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["tipforce", "estimate", str(model), str(video), "-o", str(tmp_path / "f.csv")]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    needed = "does not carry knob_deg, which the model needs; record it, or where it is constant state "
    needed += "it in bench.toml (--bench FILE): actuation.constant.knob_deg"
    assert capsys.readouterr().err.strip() == f"tipforce: {video}: {needed}"
    assert not list(tmp_path.iterdir())


def test_a_recording_may_be_told_what_its_streams_lack(model: Path, video: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, SessionInfo("first")) as writer, open_source(video) as source:
        writer.write(Actuation(0, {"x_m": 0.0}, STAGE))
        writer.write(Actuation(0, {"wire_mm": 1.0}))
        for event in source:
            writer.write(event)
    with pytest.raises(InputError, match=r"run\.mcap: does not carry knob_deg.*actuation\.constant\.knob_deg"):
        run(model, path, "-o", tmp_path / "f.csv")
    assert run(model, path, "--knob-deg", 10, "-o", tmp_path / "f.csv").exit_code == 0
    assert {row["status"] for row in rows_of(tmp_path / "f.csv")} == {"valid", "no_catheter"}


def test_a_video_that_breaks_off_leaves_nothing_behind(trained, video: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.avi"
    broken.write_bytes(b"RIFF" + bytes(2000))
    with pytest.raises(InputError), open_source(broken) as source:
        write_estimates(trained, source, tmp_path / "f.csv", overlay=tmp_path / "o.mp4")
    assert sorted(tmp_path.iterdir()) == [broken]


def test_an_error_half_way_leaves_nothing_behind(trained, video: Path, tmp_path: Path) -> None:
    def stop(what: str, share: float) -> None:
        if what == "frame 7":
            raise InputError("stopped")

    with pytest.raises(InputError, match="stopped"), open_source(video, actuation=KNOB) as source:
        write_estimates(trained, source, tmp_path / "f.csv", overlay=tmp_path / "o.mp4", progress=stop)
    assert not list(tmp_path.iterdir())


def test_outputs_make_their_folders(trained, video: Path, tmp_path: Path) -> None:
    with open_source(video, actuation=KNOB) as source:
        write_estimates(trained, source, tmp_path / "new" / "f.csv", overlay=tmp_path / "other" / "o.mp4")
    assert (tmp_path / "new" / "f.csv").is_file()
    assert (tmp_path / "other" / "o.mp4").is_file()


def test_facts_that_the_model_needs_are_asked_for_before_the_work(trained, video: Path, tmp_path: Path) -> None:
    class Stated:
        required_metadata = ("catheter.flexible_length_m", "views.camera.metres_per_px", "views.camera.base_side")
        obstacle = Estimator.obstacle

        def for_views(self, there):
            return self

        def __getattr__(self, name):
            return getattr(trained, name)

    wanted = (
        r"t\.mp4: catheter\.flexible_length_m, views\.camera\.metres_per_px, views\.camera\.base_side are not stated.*"
        r"add them to bench\.toml"
    )
    with (
        open_source(video, actuation=KNOB) as source,
        pytest.raises(InputError, match=wanted.replace("t", re.escape(video.stem), 1)),
    ):
        write_estimates(Stated(), source, tmp_path / "f.csv")
    assert not (tmp_path / "f.csv").exists()
    facts = ["catheter.flexible_length_m=0.04", "views.camera.metres_per_px=2e-4", "views.camera.base_side=left"]
    stated = stated_info(None, facts)
    with open_source(video, actuation=KNOB, stated=stated) as source:
        assert source.session_info.name == video.stem
        assert write_estimates(Stated(), source, tmp_path / "f.csv").frames == 20


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--fact", "left", "expected KEY=VALUE"),
        ("--fact", "views.camera.base_side=up", "input should be 'left', 'right', 'top' or 'bottom'"),
        ("--fact", "actuation.knob_gain_per_m_deg=much", "input should be a valid number"),
        ("--fact", "views.camera.metres_per_px=-1", "expected 1e-08 to 0.01 metres"),
        ("--fact", "catheter.length=1", "catheter.length is not known; catheter may hold name, diameter_m"),
        ("--bench", "nowhere.toml", "nowhere.toml: does not exist; write one with `tipforce init-bench"),
        ("--knob-deg", "nan", "--knob-deg: expected degrees, got 'nan'"),
    ],
)
def test_facts_that_are_none_are_refused(model, video, tmp_path, option, value, said, capsys, monkeypatch) -> None:
    words = ["tipforce", "estimate", str(model), str(video), "-o", str(tmp_path / "f.csv"), f"{option}={value}"]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit):
        main()
    assert said in " ".join(capsys.readouterr().err.split())


def test_an_interval_without_an_end_is_written_as_nothing(trained, video: Path, tmp_path: Path) -> None:
    class Unsure:
        def for_views(self, there):
            return self

        def __getattr__(self, name):
            return getattr(trained, name)

        def start_on(self, *words):
            stream = trained.start_on(*words)
            return SimpleNamespace(update=lambda observation: widened(stream.update(observation)))

    def widened(estimate: ForceEstimate) -> ForceEstimate:
        if not estimate.valid:
            return estimate
        return replace(estimate, magnitude_interval_n=np.array([0.0, np.inf]), interval_n=np.full((3, 2), np.inf))

    table = io.StringIO()
    with open_source(video, actuation=KNOB) as source:
        write_estimates(Unsure(), source, table, overlay=tmp_path / "o.mp4")
    row = next(csv.DictReader(io.StringIO(table.getvalue())))
    assert row["magnitude_n"]
    assert row["magnitude_low_n"] == row["magnitude_high_n"] == row["fy_low_n"] == ""


@pytest.mark.parametrize("form", ["video", pytest.param("recording", marks=pytest.mark.slow)])
def test_mirrored_images_are_refused_where_the_knob_tells(model: Path, tmp_path: Path, form: str) -> None:
    """The shaft rests bent by 0.8 rad, as the knob asks, and is pushed now and then."""
    images = [draw_image(0.8 if k % 2 else bend_at(k)) for k in range(10)]
    asked = SessionInfo("run", Catheter(flexible_length_m=0.04), actuation=ActuationInfo(2.0, constant=KNOB))

    def written(name: str, seen: list[Image]) -> Path:
        frames = [Frame(k * 40_000_000, image) for k, image in enumerate(seen)]
        if form == "video":
            write_video(tmp_path / f"{name}.mp4", frames, 25.0)
            return tmp_path / f"{name}.mp4"
        with RecordingWriter(tmp_path / f"{name}.mcap", SessionInfo(name)) as writer:
            for frame in frames:
                writer.write(Actuation(frame.stamp_ns, KNOB))
                writer.write(frame)
        return tmp_path / f"{name}.mcap"

    upright = written("upright", images)
    mirrored = written("mirrored", [np.ascontiguousarray(image[::-1]) for image in images])
    assert sum(each.valid for each in estimate(model, upright, bench=asked)) > 5
    with pytest.raises(InputError, match=r"mirrored.* bends by -\d+ degrees, and the knob asks for \+46"):
        next(estimate(model, mirrored, bench=asked))
    # without the knob's gain, or where the shaft never rests, a mirrored catheter is a catheter, too
    assert next(estimate(model, mirrored, bench=replace(asked, actuation=ActuationInfo(constant=KNOB)))).valid
    restless = written("restless", [np.ascontiguousarray(draw_image(bend_at(k))[::-1]) for k in range(10)])
    assert next(estimate(model, restless, bench=asked)).valid
