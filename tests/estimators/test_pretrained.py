"""Models that come with the program: found by a word, whole, small, each with its card."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce._system.executor import LocalExecutor
from tipforce.cli import app
from tipforce.datasets import PERTURBATIONS, Dataset, open_dataset, perturbed
from tipforce.errors import ModelError
from tipforce.estimators import (
    NetworkEstimator,
    create,
    load_model,
    load_pretrained,
    located,
    pretrained_names,
    read_manifest,
    save_model,
)
from tipforce.estimators.store import _pretrained
from tipforce.evaluation import methods_from
from tipforce.pipelines import write_samples
from tipforce.simulation import PRESETS, sample_set
from tipforce.types import ActuationInfo, Catheter, Observation, SessionInfo, Status, ViewInfo

QUICK = {"c": (10.0,), "epsilon": (0.01,), "sigma": (1.0,), "force": "components"}
MOST_BYTES = 33_000_000


@pytest.fixture
def stand_in(world: Callable[..., Dataset], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small model where the pretrained ones lie."""
    monkeypatch.setattr(_pretrained, "PRETRAINED", tmp_path / "package" / "pretrained")
    data = world(2, 30)
    return save_model(create("svr", QUICK).fit(data), tmp_path / "package" / "pretrained" / "stand-in", data)


@pytest.mark.parametrize("name", ["pretrained/compact", "pretrained/compact-wide", "pretrained/dcfe"])
@pytest.mark.parametrize("contrast", [30.0, 300.0])
def test_white_noise_has_no_force(name: str, contrast: float) -> None:
    """As an analog camera sends it that has lost its signal."""
    info = SessionInfo(
        "s", Catheter("7F", 2.33e-3, 40e-3, 8e-3, 4.3e-4), {"camera": ViewInfo(2e-4, "left")},
        actuation=ActuationInfo(0.533),
    )  # fmt: skip
    stream = load_model(name).start(info)
    for seed in range(12):
        noise = np.random.default_rng(seed).normal(160.0, contrast, (480, 640)).clip(0, 255).astype(np.uint8)
        answer = stream.update(Observation(seed * 40_000_000, {"camera": noise}, {"knob_deg": 10.0}))
        assert (answer.status, answer.detail[:18]) == (Status.NO_CATHETER, "the image is noise")


def test_a_word_names_a_model_wherever_a_folder_does(stand_in: Path, tmp_path: Path) -> None:
    assert pretrained_names() == ("stand-in",)
    assert located("pretrained/stand-in") == stand_in
    wanted = load_model(stand_in).describe()
    assert load_model("pretrained/stand-in").describe() == load_pretrained("stand-in").describe() == wanted
    assert read_manifest("pretrained/stand-in")["method"] == "svr"
    judged, method = methods_from(["pretrained/stand-in", "svr"])
    assert (judged.label, method.label) == ("pretrained/stand-in", "svr")
    assert judged.trained_sessions == set(read_manifest(stand_in)["training"]["session_fingerprints"].values())
    assert len(judged.trained_sessions) == 2


def test_a_folder_of_that_name_comes_first(stand_in: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "here" / "pretrained" / "stand-in"
    own.mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    assert located("pretrained/stand-in") == Path("pretrained/stand-in")
    with pytest.raises(ModelError, match=r"is no model folder"):
        load_model("pretrained/stand-in")
    assert load_pretrained("stand-in").name == "svr"


def test_a_name_that_is_none_tells_which_there_are(stand_in: Path, tmp_path: Path) -> None:
    for ask in (load_pretrained, lambda name: load_model(f"pretrained/{name}"), lambda n: located(f"pretrained/{n}")):
        with pytest.raises(ModelError, match=r"pretrained/none: no such model .*; there are: pretrained/stand-in$"):
            ask("none")
    result = CliRunner().invoke(app, ["estimate", "pretrained/none", str(tmp_path / "video.mp4")])
    assert isinstance(result.exception, ModelError)


def test_models_that_come_with_the_program_are_whole_small_and_described() -> None:
    assert sorted(path.name for path in _pretrained.PRETRAINED.glob("[!_.]*")) == list(pretrained_names())
    for name in pretrained_names():
        folder = located(f"pretrained/{name}")
        manifest = read_manifest(folder)
        assert load_pretrained(name).name == manifest["method"]
        assert sorted(path.name for path in folder.iterdir()) == sorted(manifest["sha256"]), "nothing else beside it"
        card = (folder / "README.md").read_text(encoding="utf-8")
        for wanted in ("Research use only", "## Figures", "Apache-2.0", "never saw"):
            assert wanted in card
        assert manifest["training"]["title"] in card
        assert "/tmp" not in json.dumps(manifest)
    total = sum(path.stat().st_size for path in _pretrained.PRETRAINED.rglob("*") if path.is_file())
    assert total <= MOST_BYTES


@pytest.fixture(scope="module")
def unseen(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Three sessions of the simulated bench that none was trained on."""
    folder = tmp_path_factory.mktemp("simulated") / "set"
    wanted = sample_set(PRESETS["bench-2021"], seed=77, samples=36, per_session=12, seconds=10.0)
    write_samples(
        folder, wanted, shards=False, masks=False, executor=LocalExecutor(1), say=print, lossless=False,
        progress=lambda what, share: None,
    )  # fmt: skip
    return open_dataset(folder)


def test_compact_refuses_the_images_of_a_bench_that_moved(unseen: Dataset) -> None:
    model = load_pretrained("compact")
    far = {("shift", "40 px", "up"), ("shift", "40 px", "down")}
    far |= {("turn", size, way) for size in ("15°", "45°") for way in ("clockwise", "counter-clockwise")}
    moved = [each for each in PERTURBATIONS if (each.kind, each.size, each.way) in far]
    assert len(moved) == 6
    some = unseen.subset(np.arange(0, len(unseen), 3))
    for how in moved:
        details = [each.detail for each in model.predict(perturbed(some, how)) if not each.valid]
        assert sum("shifted, rotated, or of another scale" in each for each in details) >= 0.8 * len(some), how


def test_compact_answers_an_image_and_its_mirror_image_alike(unseen: Dataset) -> None:
    model = load_pretrained("compact")
    assert isinstance(model, NetworkEstimator)
    assert model.fitted_ is not None
    graph, session = model.fitted_.graph, unseen.session[0]
    row = model.reader(unseen.session_info[session], training=False)(next(unseen.observations()))
    assert isinstance(row, dict)
    image, metadata = row["image"][None], row["metadata"][None]
    force = graph(image=image, metadata=metadata)["force_n"][0]
    other = graph(image=image[:, ::-1].copy(), metadata=metadata * np.float32([1, 1, 1, -1]))["force_n"][0]
    np.testing.assert_allclose(other, force * [1, -1, 1], atol=1e-4)


@pytest.mark.slow
def test_compact_bears_small_disturbances(unseen: Dataset) -> None:
    model = load_pretrained("compact")
    near = {("shift", "10 px"), ("shift", "20 px"), ("zoom", "× 1.1"), ("object", "10 %")}
    some = unseen.subset(np.arange(0, len(unseen), 3))
    worst = 0.4 * np.mean(np.abs(some.magnitude_n - some.magnitude_n.mean()))
    for how in PERTURBATIONS:
        if (how.kind, how.size) in near:
            answers = model.predict(perturbed(some, how))
            assert sum(each.valid for each in answers) >= 0.8 * len(some), how
            assert np.nanmean([abs(a.magnitude_n - f) for a, f in zip(answers, some.magnitude_n, strict=True)]) < worst


@pytest.mark.parametrize("name", ["compact", "compact-wide", "dcfe"])
def test_those_for_the_simulated_bench_read_sessions_that_they_never_saw(name: str, unseen: Dataset) -> None:
    data, model = unseen, load_pretrained(name)
    answers = model.predict(data)
    valid = np.array([each.valid for each in answers])
    assert valid.mean() > 0.7
    off = np.array([each.magnitude_n for each in answers]) - data.magnitude_n
    assert np.nanmean(np.abs(off)) < 0.6 * np.mean(np.abs(data.magnitude_n - data.magnitude_n.mean()))
    stream, first = model.start(data.session_info[data.session[0]]), next(data.observations())
    for shown in (
        np.zeros((480, 640, 3), np.uint8),
        np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8),
    ):
        assert not stream.update(replace(first, views={"camera": shown})).valid
