"""Annotated images become a detector folder that the next fine-tuning can begin with; bad input is refused at once."""

import json
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import FileFormatError, InputError, ModelError
from tipforce.pipelines import LocatorFineTuneSettings, _fine_tune_locator, fine_tune_locator
from tipforce.pipelines._fine_tune_locator import _graph_paths
from tipforce.vision import Annotation, locator

torch = pytest.importorskip("torch")
pytest.importorskip("onnxscript")


def bench_image(tip_v: float) -> np.ndarray:
    image = np.full((96, 128), 190, np.uint8)
    for u in range(8, 100):
        v = round(48 + (tip_v - 48) * ((u - 8) / 92) ** 2)
        image[v - 2 : v + 3, u] = 30
    return image


ANNOTATIONS = [
    Annotation(f"{k}.png", np.array([[8.0, 48.0], [54.0, 48 + 0.25 * (tip - 48)], [99.0, tip]]))
    for k, tip in enumerate((40.0, 44.0, 48.0, 56.0, 60.0))
]
IMAGES = [bench_image(each.points_px[-1, 1]) for each in ANNOTATIONS]


@pytest.fixture(scope="module")
def init(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("init")
    for name, graph in (("detector.onnx", "locator.onnx"), ("line.onnx", "refine.onnx")):
        (folder / name).write_bytes(Path(locator.__file__).with_name(graph).read_bytes())
    return folder


@pytest.fixture(autouse=True)
def few_windows(monkeypatch):
    from tipforce.training import locator as training

    few = {name: values[::24] for name, values in training.rehearsal_windows().items()}
    monkeypatch.setattr(training, "rehearsal_windows", lambda: few)


def test_annotated_images_become_a_detector_folder(init, tmp_path: Path):
    from tipforce.training.locator import locator_from_graph

    folder, heard = tmp_path / "detector", list[float]()
    empty = Annotation("empty.png", np.empty((0, 2)), present=False)
    result = fine_tune_locator(
        [*ANNOTATIONS, empty],
        [*IMAGES, np.full((96, 128), 190, np.uint8)],
        folder,
        init=init,
        settings=LocatorFineTuneSettings(steps=2),
        on_progress=lambda _text, share: heard.append(share),
    )
    assert sorted(path.name for path in folder.iterdir()) == [
        "README.md",
        "detector.json",
        "detector.onnx",
        "line.onnx",
    ]
    facts = json.loads((folder / "detector.json").read_text())
    assert facts["frames"] == 5  # four with a catheter, one without
    assert facts["left_out"] == [result.left_out[0].image]
    assert facts["steps"] == [2, 2]
    assert abs(facts["log_odds"]) < 3.0
    assert facts["after"]["frames"] == 1
    assert result.left_out[0].after_px.shape[1:] == (2,)
    assert "Images left out of the training: 1" in (folder / "README.md").read_text()
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    tuned = locator_from_graph(folder / "detector.onnx")
    assert not torch.equal(tuned.head.weight, locator_from_graph(init / "detector.onnx").head.weight)
    session = pytest.importorskip("onnxruntime").InferenceSession(str(folder / "detector.onnx"))
    assert [each.name for each in session.get_outputs()] == ["heat", "states", "present"]


def test_a_detector_for_xray_images_begins_with_the_network_for_them(monkeypatch, tmp_path: Path):
    begun: list[Path | None] = []

    def paths(first: Path | None) -> list[Path]:
        begun.append(first)
        raise ModelError("no training")

    monkeypatch.setattr(_fine_tune_locator, "_graph_paths", paths)
    with pytest.raises(ModelError):
        fine_tune_locator(ANNOTATIONS, IMAGES, tmp_path / "out", xray=True)
    assert begun == [locator.XRAY_DETECTOR]
    assert all(path.is_file() for path in _graph_paths(locator.XRAY_DETECTOR))


def test_a_cancelled_training_leaves_the_old_folder(init, tmp_path: Path):
    folder = tmp_path / "detector"
    folder.mkdir()
    (folder / "detector.json").write_text("{}")

    def cancel(_text: str, _share: float) -> None:
        raise RuntimeError("cancelled")

    with pytest.raises(RuntimeError, match="cancelled"):
        fine_tune_locator(ANNOTATIONS, IMAGES, folder, init=init, on_progress=cancel)
    assert [path.name for path in tmp_path.iterdir()] == ["detector"]
    assert (folder / "detector.json").read_text() == "{}"


def test_one_annotated_image_is_too_few(init, tmp_path: Path):
    with pytest.raises(InputError, match=r"1 annotated image with a catheter; .* at least 2"):
        fine_tune_locator(ANNOTATIONS[:1], IMAGES[:1], tmp_path / "out", init=init)


def test_every_annotation_needs_its_image(init, tmp_path: Path):
    with pytest.raises(InputError, match="5 annotations for 4 images"):
        fine_tune_locator(ANNOTATIONS, IMAGES[:4], tmp_path / "out", init=init)


def test_a_detector_that_is_missing_or_another_file_is_refused_with_its_path(tmp_path: Path):
    with pytest.raises(FileFormatError, match=r"none.detector\.onnx: there is no such file"):
        fine_tune_locator(ANNOTATIONS, IMAGES, tmp_path / "out", init=tmp_path / "none")
    for name in ("detector.onnx", "line.onnx"):
        (tmp_path / name).write_bytes(b"no graph")
    with pytest.raises(ModelError, match=r"detector\.onnx: this is no graph of the locator"):
        fine_tune_locator(ANNOTATIONS, IMAGES, tmp_path / "out", init=tmp_path)
