"""Methods that are networks, from a dataset of images to a model folder and back."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tipforce.datasets import Dataset
from tipforce.errors import InputError, ModelError, NotFittedError
from tipforce.estimators import (
    Dcfe,
    DcfeSettings,
    NetworkEstimator,
    create,
    export_onnx,
    load_model,
    read_manifest,
    save_model,
    train,
    training_lines,
)
from tipforce.estimators.networks import _network
from tipforce.estimators.networks._preparation import prepare
from tipforce.training import graph_weights
from tipforce.types import Observation, SessionInfo, Status

pytest.importorskip("torch", reason="training needs the extra [train]")
pytest.importorskip("onnxscript", reason="training needs the extra [train]")

Make = Callable[..., Dataset]


def stored(estimator: NetworkEstimator) -> dict[str, np.ndarray]:
    """Initialisers of its graph, as they are kept."""
    onnx = pytest.importorskip("onnx", reason="training needs the extra [train]")
    graph = onnx.load_from_string(estimator.files()["model.onnx"]).graph
    return {each.name: onnx.numpy_helper.to_array(each) for each in graph.initializer}


def forces(estimator: Any, data: Dataset) -> np.ndarray:
    return np.array([answer.force_n for answer in estimator.predict(data)])


@pytest.fixture(scope="module")
def learnt(small_type: type[NetworkEstimator], shown: Make) -> NetworkEstimator:
    """Fitted once; not to be changed."""
    return small_type().fit(shown())


def test_it_learns_what_is_in_the_images(learnt: NetworkEstimator, shown: Make) -> None:
    fresh = shown(seed=1)
    wrong = forces(learnt, fresh)[:, :2] - fresh.force_n[:, :2]
    assert np.mean(np.abs(wrong)) < 0.07  # 0.1 N by always answering the mean
    answer = learnt.predict(fresh)[0]
    assert answer.known.tolist() == [True, True, False]
    assert np.isfinite(answer.interval_n[:2]).all()
    assert not learnt.uses_history
    assert learnt.describe().interval_basis == "random samples that also chose the epoch, of 3 sessions"


def test_a_model_folder_answers_the_same(
    learnt: NetworkEstimator, shown: Make, tmp_path: Path, small: NetworkEstimator
) -> None:
    data = shown()
    folder = save_model(learnt, tmp_path / "m", data)
    loaded = load_model(folder)
    assert np.array_equal(forces(learnt, data), forces(loaded, data), equal_nan=True)
    assert loaded.describe() == learnt.describe()
    assert loaded.settings == learnt.settings
    rows = [json.loads(line) for line in (folder / "training.jsonl").read_text().splitlines()]
    assert [row["epoch"] for row in rows] == list(range(1, 13))
    manifest = read_manifest(folder)
    assert {"model.onnx", "training.jsonl"} <= set(manifest["sha256"])
    card, lines = (folder / "README.md").read_text(), "\n".join(training_lines(learnt, manifest))
    for said in ("12 of 12 epochs", "all epochs were run", "random samples that also chose the epoch"):
        assert said in card
        assert said in lines
    facts = export_onnx(loaded, tmp_path / "small.onnx")
    assert (tmp_path / "small.onnx").read_bytes() == (folder / "model.onnx").read_bytes()
    assert 0 < facts["parity_n"] < 1e-3
    loaded.calibrate(shown(sessions=9, each=8, seed=2))
    assert loaded.describe().interval_basis == "whole sessions"
    with pytest.raises(InputError, match="the first says: nothing was filmed"):
        loaded.calibrate(shown(unseen=tuple(range(72))))
    with pytest.raises(NotFittedError, match="small was not fitted"):
        small.calibrate(shown())


def test_a_graph_that_answers_otherwise_is_no_model(
    small: NetworkEstimator, shown: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_network, "export_graph", lambda *_, **__: b"")
    monkeypatch.setattr(_network, "parity_n", lambda *_: float("nan"))
    with pytest.raises(ModelError, match="differs from the trained network by up to nan N"):
        small.fit(shown())
    assert small.fitted_ is None


def test_weights_are_kept_whole_where_half_precision_is_too_coarse(
    learnt: NetworkEstimator, shown: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    deviations = iter([2e-3, 1e-5])
    monkeypatch.setattr(_network, "parity_n", lambda *_: next(deviations))
    whole = type(learnt)(learnt.settings.model_copy(update={"epochs": 1})).fit(shown())
    assert whole.describe().parity_with_network_n == 1e-5
    halves, wholes = (sum(value.nbytes for value in stored(each).values()) for each in (learnt, whole))
    assert wholes > 1.5 * halves


def test_actuation_and_samples_that_cannot_be_read(small: NetworkEstimator, shown: Make) -> None:
    settings = small.settings.model_copy(update={"actuation": ("knob_deg",), "epochs": 1})
    data = shown(unseen=(3, 40))
    fitted = type(small)(settings).fit(data)
    assert sum(lost for lost, _ in fitted.describe().left_out.values()) == 2
    unseen = fitted.predict(data.subset(np.array([3])))[0]
    assert (unseen.status, unseen.detail) == (Status.NO_CATHETER, "nothing was filmed")
    assert fitted.required_actuation == ("knob_deg",)
    stream = fitted.start(SessionInfo())
    image = next(iter(data.observations())).views
    low, high = (stream.update(Observation(0, image, {"knob_deg": knob})).force_n[:2] for knob in (10.0, 30.0))
    assert not np.array_equal(low, high)
    assert stream.update(Observation(0, image, {})).status is Status.MISSING_INPUT


def test_what_is_prepared_is_kept_and_not_made_again(shown: Make, tmp_path: Path) -> None:
    data = shown(unseen=(1,))

    def read(_: str, observation: Observation, mask: Any) -> Any:
        view = observation.views.get("camera")
        return _network.Abstention(Status.NO_CATHETER, "dark") if view is None else {"corner": view[:2, :3]}

    def made(key: str, part: Dataset) -> Any:
        return prepare(
            part, [None] * len(part), {"corner": ((2, 3), "uint8")}, read, tmp_path, key, part.names, lambda _: None
        )

    first = made("a", data)
    assert data.store.reads == 72
    assert first.index.tolist() == [0, *range(2, 72)]
    assert first.first_skipped == "001.png: dark (no_catheter)"
    wanted = [each.views["camera"][:2, :3] for each in data.subset(first.index).observations()]
    assert np.array_equal(first.arrays["corner"], wanted)
    before = data.store.reads
    again = made("a", data)
    assert data.store.reads == before
    assert np.array_equal(again.arrays["corner"], wanted)
    made("b", data)
    made("b", data.subset(np.arange(5)))
    assert data.store.reads == before + 72 + 5


def test_fine_tuning_starts_from_the_weights_of_a_model(
    learnt: NetworkEstimator, small: NetworkEstimator, shown: Make
) -> None:
    still = type(small)(small.settings.model_copy(update={"epochs": 1, "rate": 1e-30}))
    after = train(still, shown(), start=learnt).estimator
    again = still.fine_tuned_from(learnt).unfitted().fit(shown())  # as every split of an evaluation does
    weights = [graph_weights(each.files()["model.onnx"])["dense.weight"] for each in (learnt, after, again)]
    assert np.array_equal(weights[0], weights[1])
    assert np.array_equal(weights[0], weights[2])
    with pytest.raises(InputError, match="a dcfe cannot start from the weights of a small"):
        Dcfe().fine_tuned_from(learnt)
    assert "fine-tuned from the weights of small" in "\n".join(after.describe().summary().training)
    with pytest.raises(InputError, match="svr is no network"):
        train(create("svr"), shown(), start=learnt)


def test_what_cannot_be_learnt_from_is_refused(
    small: NetworkEstimator, shown: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="has 10 samples; training small needs at least 20"):
        small.fit(shown().subset(np.arange(10)))
    data = shown()
    data.known[:] = False
    with pytest.raises(InputError, match="no force components to learn; small needs at least fx_n or fy_n"):
        small.fit(data)
    data = shown()
    data.force_n[5, 0] = np.nan
    with pytest.raises(InputError, match="some samples have no force"):
        small.fit(data)
    with pytest.raises(InputError, match=r"12 of 72 samples can be read, .*: 000.png: nothing was filmed"):
        small.fit(shown(unseen=tuple(range(60))))
    with pytest.raises(InputError, match="has no actuation 'wire_mm'"):
        type(small)(small.settings.model_copy(update={"actuation": ("wire_mm",)})).fit(shown())
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 1000})())
    with pytest.raises(InputError, match=r"preparing the images of squares needs 0.0 GB, 0.0 GB are free"):
        small.fit(shown())


def test_dcfe_takes_images_and_says_what_it_cannot_take() -> None:
    dcfe = create("dcfe")
    assert isinstance(dcfe, Dcfe)
    read = dcfe.reader(SessionInfo(), training=False)
    grey = read(Observation(0, {"camera": np.full((480, 640), 7, np.uint8)}, {}))
    assert grey["image"].shape == (224, 224, 3)
    assert np.unique(grey["image"]).tolist() == [7]
    colour = np.zeros((448, 224, 3), np.uint8)
    colour[:, :112, 0] = 200
    found = read(Observation(0, {"camera": colour}, {}))["image"]
    assert found[:, :112, 0].min() == 200
    assert found[:, :, 1:].max() == 0
    refused = read(Observation(0, {"a": colour}, {}))
    assert refused.detail == "there is no view 'camera', as view says; there is a"
    assert (Dcfe.thesis_samples, DcfeSettings().epochs, DcfeSettings().components) == (615, 10_000, "xy")
