"""Recordings of two views that are exposed in turn, and methods that read one of them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app, as_options
from tipforce.datasets import open_dataset
from tipforce.errors import InputError
from tipforce.estimators import ESTIMATORS, create, load_model, read_manifest
from tipforce.io import RecordingReader, RecordingWriter, open_source, write_video
from tipforce.types import Actuation, Catheter, Frame, Observation, SensorInfo, SessionInfo, ViewInfo, Wrench

from .conftest import bend_at, draw_image  # type: ignore[import-not-found]

PERIOD_NS, APART_NS = 66_000_000, 30_000_000
GROUND = np.full((240, 320), 215, np.uint8)
SETTINGS = [
    "vision.polarity=dark",
    "vision.base_side=left",
    "force=components",
    "c=[10]",
    "epsilon=[0.01]",
    "sigma=[1]",
]
TRAIN = [word for setting in SETTINGS for word in ("--set", setting)]


def run(verb: str, *words: object):
    return CliRunner().invoke(app, [verb, *map(str, words)], catch_exceptions=True)


def write(path: Path, views: dict[str, bool], frames: int = 12, phase: int = 0) -> Path:
    """Writes a recording whose views come `APART_NS` after one another; a view of False shows only ground."""
    with RecordingWriter(path, SessionInfo(path.stem, sensor=SensorInfo(angle_deg=0.0, reads="tip-on-tissue"))) as out:
        events = []
        for k in range(frames):
            bend = bend_at(k + phase)
            for place, (view, shows) in enumerate(views.items()):
                stamp = k * PERIOD_NS + place * APART_NS
                events.append(Frame(stamp, draw_image(bend) if shows else GROUND, view))
                events.append(Wrench(stamp, np.array([0.0, 0.2 * bend, 0.0]), np.zeros(3)))
                events.append(Actuation(stamp, {"knob_deg": 10.0}))
        for event in events:
            out.write(event)
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions; the catheter is in the first view only."""
    folder = tmp_path_factory.mktemp("runs")
    for k in range(2):
        write(folder / f"s{k}.mcap", {"front": True, "side": False}, phase=5 * k)
    return folder


@pytest.fixture(scope="module")
def model(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model") / "svr"
    result = run("train", runs, "-o", folder, *TRAIN)
    assert result.exit_code == 0, result.output
    assert "the view front" in result.output
    return folder


def test_training_reads_the_first_view_and_the_model_keeps_its_name(model: Path) -> None:
    assert read_manifest(model)["settings"]["vision"]["view"] == "front"
    assert "It reads the view front." in (model / "README.md").read_text()
    assert load_model(model).view_is_stated


def test_estimates_name_the_view_that_they_read(model: Path, runs: Path, tmp_path: Path) -> None:
    result = run("estimate", model, runs / "s0.mcap", "-o", tmp_path / "f.csv")
    assert result.exit_code == 0, result.output
    assert "reads the view front of front, side" in result.output
    assert "12 frames, 12 with a force" in result.output


def test_a_model_whose_view_is_missing_says_so_and_reads_another_one_on_request(model: Path, tmp_path: Path) -> None:
    other = write(tmp_path / "other.mcap", {"above": True})
    refused = run("estimate", model, other, "-o", tmp_path / "f.csv")
    assert isinstance(refused.exception, InputError)
    said = "other.mcap: there is no view 'front'; there is above, and svr reads the view front; state --view above"
    assert said in as_options(str(refused.exception))
    result = run("estimate", model, other, "-o", tmp_path / "f.csv", "--view", "above")
    assert result.exit_code == 0, result.output
    assert "12 frames, 12 with a force" in result.output


def test_the_frames_of_the_stated_view_are_the_samples(tmp_path: Path) -> None:
    for k in range(2):
        write(tmp_path / f"s{k}.mcap", {"front": False, "side": True}, phase=5 * k)
    result = run("train", tmp_path, "-o", tmp_path / "svr", *TRAIN, "--set", "vision.view=side")
    assert result.exit_code == 0, result.output
    assert read_manifest(tmp_path / "svr")["settings"]["vision"]["view"] == "side"
    assert open_dataset(tmp_path, "side").stamp_ns[0] == APART_NS
    result = run("estimate", tmp_path / "svr", tmp_path / "s0.mcap", "-o", tmp_path / "f.csv")
    assert "reads the view side of front, side" in result.output
    assert "12 frames, 12 with a force" in result.output


def test_a_wrong_name_gives_the_views_that_are_there(runs: Path, tmp_path: Path) -> None:
    refused = run("train", runs, "-o", tmp_path / "svr", *TRAIN, "--set", "vision.view=top")
    assert isinstance(refused.exception, InputError)
    assert "there is no view 'top'; there are front and side" in str(refused.exception)
    assert str(refused.exception).endswith("for example vision.view=front")
    calibrated = run("calibrate", runs / "s0.mcap")
    assert "views.front.metres_per_px is not stated" in str(calibrated.exception)


def test_an_evaluation_notes_the_view_of_each_method(model: Path, runs: Path, tmp_path: Path, no_figures: None) -> None:
    write(tmp_path / "new.mcap", {"front": True, "side": False}, phase=11)
    result = run("evaluate", model, "--data", tmp_path / "new.mcap", "--protocol", "saved", "-o", tmp_path / "report")
    assert result.exit_code == 0, (result.output, result.exception)
    notes = json.loads((tmp_path / "report" / "metrics.json").read_text())["notes"]
    assert "svr reads the view front of the views front, side." in notes


def videos(folder: Path, *names: str) -> list[Path]:
    paths = [folder / name for name in names]
    for place, path in enumerate(paths):
        frames = [Frame(k * 40_000_000, GROUND - 20 * place) for k in range(10)]
        write_video(path, frames, 25.0)
    return paths


def test_videos_of_several_views_become_one_recording(tmp_path: Path) -> None:
    paths = videos(tmp_path, "run_a.mp4", "run_b.mp4")
    (tmp_path / "force.csv").write_text("t_s,Fx,Fy,Fz\n" + "\n".join(f"{k * 0.01:.2f},0,0.1,0" for k in range(60)))
    bench = tmp_path / "bench.toml"
    bench.write_text("[views.a]\nmetres_per_px = 2e-4\n[views.b]\nmetres_per_px = 3e-4\n")
    words = [
        *paths,
        tmp_path / "force.csv",
        "--offset-ms",
        "none",
        "--tare",
        "none",
        "--fact",
        "sensor.log.force_unit=N",
    ]
    result = run("import", *words, "--bench", bench, "-o", tmp_path / "run.mcap")
    assert result.exit_code == 0, (result.output, result.exception)
    with RecordingReader(tmp_path / "run.mcap") as reader:
        assert reader.views == ("a", "b")
        assert [len(reader.stamps(view)) for view in reader.views] == [10, 10]
        assert [reader.frame_at(0, view).image.mean() for view in "ab"] == pytest.approx([215, 195], abs=2)
    result = run("import", *words, "-o", tmp_path / "without_bench.mcap")
    assert result.exit_code == 0, (result.output, result.exception)
    with RecordingReader(tmp_path / "without_bench.mcap") as reader:
        assert reader.views == ("a", "b")


def test_a_video_whose_view_is_not_known_is_refused_with_a_name_that_serves(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text("[views.a]\nmetres_per_px = 2e-4\n[views.b]\nmetres_per_px = 3e-4\n")
    first, second = videos(tmp_path, "one.mp4", "two_b.mp4")
    refused = run("import", first, second, "--bench", bench, "-o", tmp_path / "run.mcap")
    assert isinstance(refused.exception, InputError)
    assert "one.mp4: its view is not known; expected a name that ends in a view of bench.toml, as in one_a.mp4" in str(
        refused.exception
    )
    first.rename(tmp_path / "one_a.mp4")
    result = run("import", tmp_path / "one_a.mp4", second, "--bench", bench, "-o", tmp_path / "run.mcap")
    assert result.exit_code == 0, (result.output, result.exception)


def test_one_video_has_the_metadata_of_the_view_that_ends_its_name(tmp_path: Path) -> None:
    (path,) = videos(tmp_path, "run_b.mp4")
    stated = SessionInfo(views={"a": ViewInfo(2e-4), "b": ViewInfo(3e-4)})
    with open_source(path, stated=stated) as source:
        assert {event.view for event in source if isinstance(event, Frame)} == set(source.views) == {"b"}


@pytest.mark.parametrize("name", [each for each in ESTIMATORS if each not in ("fusion", "stereo", "rod-3d")])
def test_every_method_of_one_view_follows_the_rule(name: str) -> None:
    method = create(name)
    assert method.for_views(("camera", "a")) is method
    assert method.for_views(("a", "b")).views == ("a",)
    assert method.for_views(()).views == ("camera",)
    key, *rest = reversed(method.view_setting.split("."))
    stated: dict[str, object] = {key: "b"}
    for parent in rest:
        stated = {parent: stated}
    assert create(name, stated).for_views(("a", "b")).views == ("b",)
    with pytest.raises(InputError, match=r"there is no view 'b'; there are a and c, and .* reads the view b"):
        create(name, stated).for_views(("a", "c"))


def test_a_method_of_two_views_needs_both() -> None:
    stereo = create("stereo")
    assert stereo.for_views(("a", "b", "camera")) is stereo
    with pytest.raises(InputError, match="there is no view 'b'; there is a, and stereo reads the views a and b"):
        stereo.for_views(("a",))


def turned_about_x(degrees: float) -> ViewInfo:
    """A view whose camera looks along z of the base frame, turned about x."""
    cos, sin = float(np.cos(np.radians(degrees))), float(np.sin(np.radians(degrees)))
    rows = ((1000.0, 0.0, 0.0, 0.0), (0.0, 1000.0 * cos, -1000.0 * sin, 0.0), (0.0, sin, cos, 0.7))
    return ViewInfo(2e-4, "left", projection=rows, projection_frame="isocentre")


@pytest.mark.parametrize("name", ["rod", "rod-track", "beam"])
def test_a_planar_rod_is_not_fitted_in_a_view_of_another_plane(name: str) -> None:
    catheter = Catheter("7F", 2.34e-3, 0.04, 8e-3, bending_stiffness_nm2=8e-4)

    def info(degrees: float) -> SessionInfo:
        return SessionInfo("s", catheter, {"a": turned_about_x(0.0), "b": turned_about_x(degrees)})

    method = create(name)
    assert method.reading("a").obstacle(info(84.0)) == method.reading("b").obstacle(info(15.0)) == ""
    why = method.reading("b").obstacle(info(84.0))
    assert why.startswith("the view b is turned by 84 degrees from the view a")
    assert method.reading("b").start(info(84.0)).update(Observation(0, {"b": GROUND})).detail == why
    unknown = replace(info(84.0), views={"a": ViewInfo(2e-4), "b": ViewInfo(2e-4)})
    assert method.reading("b").obstacle(unknown) == ""


def test_a_shipped_model_and_fusion_read_any_view() -> None:
    network = load_model("pretrained/compact-wide").for_views(("a", "b"))
    assert network.views == ("a",)
    assert "views.a.metres_per_px" in network.required_metadata
    fusion = create("fusion")
    assert fusion.for_views(("a", "b")).views == ("a",)
    assert fusion.reading("b").views == ("b",)
    assert fusion.reading("b").unfitted().views == ("b",)
