"""The model store: whole or not at all, and never trusted blindly."""

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest

from tipforce.datasets import Dataset
from tipforce.errors import InputError, MissingExtraError, ModelError
from tipforce.estimators import ESTIMATORS, Svr, create, export_onnx, load_model, read_manifest, save_model
from tipforce.estimators.store._store import _own_sha256

World = Callable[..., Dataset]
RESOLVED = {
    "settings": {"roi": [10**9, 0, 2 * 10**9, 1]}, "polarity": "dark", "base_side": "left", "length_tolerance": 0.1
}  # fmt: skip
QUICK = {"c": (10.0,), "epsilon": (0.01,), "sigma": (1.0,), "force": "components"}


@pytest.fixture
def data(world: World) -> Dataset:
    return world()


@pytest.fixture
def model(data: Dataset, tmp_path: Path) -> Path:
    return save_model(create("svr", QUICK).fit(data), tmp_path / "models" / "svr", data, {"rmse_n": 0.01})


def forces(estimator: Any, data: Dataset) -> np.ndarray:
    return np.array([answer.force_n for answer in estimator.predict(data)])


@pytest.mark.parametrize(
    "extra",
    [{}, {"force": "magnitude"}, {"linear": 1.0, "window": {"lags_ms": [0, 100]}}],
    ids=["components", "magnitude", "window"],
)
def test_a_loaded_model_answers_the_same(data: Dataset, tmp_path: Path, extra: dict[str, Any]) -> None:
    svr = create("svr", {**QUICK, **extra}).fit(data)
    loaded = load_model(save_model(svr, tmp_path / "m", data))
    for a, b in zip(svr.predict(data), loaded.predict(data), strict=True):
        assert a.magnitude_n == b.magnitude_n
        assert np.array_equal(a.force_n, b.force_n, equal_nan=True)
        assert np.array_equal(a.interval_n, b.interval_n, equal_nan=True)
    assert loaded.describe() == svr.describe()
    assert loaded.settings == svr.settings
    again = load_model(save_model(loaded, tmp_path / "again", data))
    assert np.array_equal(forces(svr, data), forces(again, data), equal_nan=True)


def test_the_manifest_says_what_a_person_must_know(model: Path, data: Dataset) -> None:
    manifest = read_manifest(model)
    assert manifest["training"]["fingerprint"] == data.fingerprint()
    assert manifest["training"]["sessions"] == ["s0", "s1", "s2", "s3"]
    assert manifest["metrics"] == {"rmse_n": 0.01}
    assert manifest["frame_of_forces"] == "base"
    assert manifest["facts"]["parity_with_scikit_learn_n"] < 1e-9
    assert set(manifest["versions"]) == {"tipforce", "python", "numpy", "scikit-learn", "onnxruntime"}
    card = (model / "README.md").read_text()
    for needed in ("Research use only", "too few for a guarantee", "A1, A2, A3, A4, A5, knob_deg", "| fx | 10 |"):
        assert needed in card


class Filed(Svr):
    """A method that leaves files of its own beside its arrays."""

    own: dict[str, bytes]

    def files(self) -> dict[str, bytes]:
        return self.own

    @classmethod
    def from_state(cls, settings, values, arrays, files=None):
        made = super().from_state(settings, values, arrays, files)
        made.__class__ = cls
        made.own = dict(files)
        if b"wrong" in made.own["own.bin"]:
            raise ModelError("own.bin: is damaged; copy the whole model folder again")
        return made


@pytest.fixture
def filed(data: Dataset, monkeypatch: pytest.MonkeyPatch) -> Filed:
    monkeypatch.setitem(ESTIMATORS._loaded, "svr", Filed)
    made = Filed(Svr.settings_type.model_validate(QUICK)).fit(data)
    made.own = {"own.bin": b"graph \x00\xff", "training.jsonl": b"{}\n"}
    return made


def test_a_methods_own_files_travel_with_the_model(filed: Filed, data: Dataset, tmp_path: Path) -> None:
    folder = save_model(filed, tmp_path / "m", data)
    assert (folder / "own.bin").read_bytes() == b"graph \x00\xff"
    assert set(read_manifest(folder)["sha256"]) == {
        "arrays.npz", "README.md", "model.json", "own.bin", "training.jsonl"
    }  # fmt: skip
    assert load_model(folder).files() == filed.own


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: os.remove(f / "own.bin"), r"the file own\.bin is missing; train the model again or copy"),
        (lambda f: cut("own.bin", 2)(f), r"own\.bin: was altered or cut off after it was saved"),
        (lambda f: (f / "training.jsonl").write_text("{}"), r"training\.jsonl: was altered or cut off"),
    ],
)
def test_a_damaged_own_file_is_one_clear_sentence(
    filed: Filed, data: Dataset, tmp_path: Path, damage: Callable[[Path], None], message: str
) -> None:
    folder = save_model(filed, tmp_path / "m", data)
    damage(folder)
    with pytest.raises(ModelError, match=message) as caught:
        load_model(folder)
    assert "\n" not in str(caught.value)


def test_what_a_method_says_of_its_files_names_the_folder(filed: Filed, data: Dataset, tmp_path: Path) -> None:
    filed.own["own.bin"] = b"wrong"
    folder = save_model(filed, tmp_path / "m", data)
    with pytest.raises(ModelError, match=r"m: own\.bin: is damaged; copy the whole model folder again"):
        load_model(folder)


@pytest.mark.parametrize("name", ["model.json", "arrays.npz", "README.md", "../model.onnx", "a/b.onnx", "..", ".x"])
def test_own_files_keep_to_the_folder(filed: Filed, data: Dataset, tmp_path: Path, name: str) -> None:
    filed.own = {name: b""}
    with pytest.raises(ValueError, match="no names for files of a model folder"):
        save_model(filed, tmp_path / "m", data)
    assert list(tmp_path.rglob("m")) == []


def test_a_card_may_be_added_to(model: Path) -> None:
    with (model / "README.md").open("a") as card:
        card.write("Used on Monday.\n")
    load_model(model)


def test_saving_is_whole_or_not_at_all(
    model: Path, data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    svr = create("svr", QUICK).fit(data)
    with pytest.raises(InputError, match="exists already"):
        save_model(svr, model, data)
    before = (model / "model.json").read_text()

    def broken(*_: Any, **__: Any) -> None:
        raise OSError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez", broken)
        with pytest.raises(OSError, match="disk full"):
            save_model(svr, model, data, overwrite=True)
    assert (model / "model.json").read_text() == before
    assert [path.name for path in model.parent.iterdir()] == ["svr"]
    save_model(svr, model, data, {"new": 1}, overwrite=True)
    assert read_manifest(model)["metrics"] == {"new": 1}
    assert [path.name for path in model.parent.iterdir()] == ["svr"]


def test_overwriting_replaces_models_only(data: Dataset, tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.txt").write_text("years of work")
    with pytest.raises(InputError, match="is no model folder"):
        save_model(create("svr", QUICK).fit(data), tmp_path / "thesis", data, overwrite=True)
    assert (tmp_path / "thesis" / "chapter.txt").exists()


def test_answers_that_differ_from_scikit_learn_are_not_saved(data: Dataset, tmp_path: Path) -> None:
    svr = create("svr", QUICK).fit(data)
    assert isinstance(svr, Svr)
    assert svr.fitted_ is not None
    object.__setattr__(svr.fitted_.model.machines, "parity_n", 2e-6)
    with pytest.raises(ModelError, match="differ from scikit-learn's by up to 2e-06 N"):
        save_model(svr, tmp_path / "m", data)
    assert not (tmp_path / "m").exists()


def edit(*, signed: bool = False, **changes: Any) -> Callable[[Path], None]:
    """Changed by hand; ``signed``: with a checksum that fits, as another program would write it."""

    def change(folder: Path) -> None:
        path = folder / "model.json"
        changed = {**json.loads(path.read_text()), **changes}
        if signed:
            changed["sha256"]["model.json"] = _own_sha256(changed)
        path.write_text(json.dumps(changed))

    return change


def cut(name: str, by: int = 40) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:-by])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: os.remove(f / "model.json"), r"is no model folder, there is no model\.json; make one with"),
        (lambda f: os.remove(f / "arrays.npz"), r"the file arrays\.npz is missing"),
        (cut("arrays.npz"), r"arrays\.npz: was altered or cut off after it was saved"),
        (cut("model.json"), r"model\.json: is no JSON"),
        (edit(seed=5), r"model\.json: was altered"),
        (edit(sha256={}), r"model\.json: was altered"),
        (edit(sha256=None), r"model\.json: sha256 is no list of named values"),
        (edit(training=None), r"model\.json: training is no list of named values"),
        (edit(format_version=99), r"format version 99, this program reads version 2; update tipforce"),
        (edit(format_version=1), r"the older format version 1.*train the model again"),
        (edit(method="oracle"), r"made by the method 'oracle', this program has svr"),
        (edit(signed=True, settings={"kernel": "cubic"}), r"does not fit the method svr"),
        (edit(signed=True, state={}), r"does not fit the method svr"),
        (lambda f: (f / "model.json").write_text("{}"), r"model\.json: is damaged"),
        (lambda f: (f / "model.json").write_text('{"format_version": 2}'), r"lacks facts, method"),
    ],
)
def test_a_damaged_model_is_one_clear_sentence(model: Path, damage: Callable[[Path], None], message: str) -> None:
    damage(model)
    with pytest.raises(ModelError, match=message) as caught:
        load_model(model)
    assert "\n" not in str(caught.value)


def long(name: str) -> Callable[[Path], None]:
    """A file with a hole of two gigabytes."""

    def change(folder: Path) -> None:
        with (folder / name).open("r+b") as stream:
            stream.truncate(2 << 30)

    return change


def link(name: str, to: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).unlink()
        (folder / name).symlink_to(to)

    return change


def pipe(folder: Path) -> None:
    (folder / "arrays.npz").unlink()
    os.mkfifo(folder / "arrays.npz")


def rewritten(**new: Any) -> Callable[[Path], None]:
    """Other arrays, with checksums that fit: what somebody would do on purpose."""

    def change(folder: Path) -> None:
        with np.load(folder / "arrays.npz") as stored:
            arrays = {**stored, **{name: make(stored[name]) for name, make in new.items()}}
        np.savez(folder / "arrays.npz", **arrays)
        signed_again(folder)

    return change


def state(**new: Any) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        signed_again(folder, lambda manifest: manifest["state"].update(new))

    return change


def interval(**new: Any) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        signed_again(folder, lambda manifest: manifest["state"]["interval"].update(new))

    return change


def signed_again(folder: Path, change: Callable[[dict[str, Any]], None] = lambda _: None) -> None:
    manifest = json.loads((folder / "model.json").read_text())
    manifest["sha256"]["arrays.npz"] = hashlib.sha256((folder / "arrays.npz").read_bytes()).hexdigest()
    change(manifest)
    manifest["sha256"]["model.json"] = _own_sha256(manifest)
    (folder / "model.json").write_text(json.dumps(manifest))


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda f: (f / "model.json").write_text("[" * 200_000), r"model\.json: .*nested more than"),
        (lambda f: (f / "model.json").write_text("[1]"), r"model\.json: is damaged"),
        (long("model.json"), r"model\.json: is longer than 64 MiB"),
        (long("arrays.npz"), r"arrays\.npz: has 2147483648 bytes, more than the 1024 MiB"),
        (link("model.json", "/dev/zero"), r"there is no model\.json"),
        (link("arrays.npz", "/dev/zero"), r"the file arrays\.npz is missing"),
        (pipe, r"the file arrays\.npz is missing"),
        (edit(signed=True, sha256={"../a": "", "arrays.npz": "", "model.json": ""}), r"names the file '\.\./a'"),
        (edit(signed=True, sha256={"/dev/zero": "", "arrays.npz": ""}), r"names the file '/dev/zero'"),
        (edit(signed=True, method=["svr"]), r"made by the method"),
        (rewritten(dual=lambda a: a * np.nan), "dual holds values that are not finite numbers"),
        (rewritten(unit_n=lambda a: a * 1e30), "unit_n holds values that are not finite numbers from 0 to 1e"),
        (rewritten(vectors=lambda a: a[:, :2]), r"vectors has the shape \(\d+, 2\), expected \(n, 6\)"),
        (rewritten(ends=lambda a: a + 1000), "ends holds values that are not finite numbers from 0"),
        (rewritten(ends=lambda a: a[::-1]), "do not part"),
        (rewritten(shift=lambda a: a.astype("U")), "shift holds no numbers"),
        (interval(magnitude_half_width_n=-0.1), "half-widths of intervals must not be negative"),
        (interval(half_width_n=[None, 0.1, None]), "half-widths of intervals must not be negative"),
        (interval(half_width_n=[0.1]), "half-widths of intervals"),
        (interval(covariance_n2=[[-1.0] * 3] * 3), "no covariance"),
        (state(known=[True]), "does not fit the method svr"),
        (state(actuation_limits={"knob_deg": [0.0, 1e30]}), "does not fit the method svr"),
        (state(vision={"settings": {"points": 10**9}}), r"vision\.settings\.points=1000000000: Input should be less"),
        (state(vision=RESOLVED), "vision was resolved with other settings than those of the model"),
        (state(vision={**RESOLVED, "settings": {}, "tip_template": [7] * 14}), "does not fit the method svr"),
    ],
)
def test_a_model_that_was_changed_on_purpose_is_one_clear_sentence(
    model: Path, harm: Callable[[Path], None], message: str
) -> None:
    harm(model)
    with pytest.raises(ModelError, match=message) as caught:
        load_model(model)
    assert "\n" not in str(caught.value)


def test_a_card_of_any_length_is_not_read(model: Path) -> None:
    long("README.md")(model)
    load_model(model)


def test_a_force_that_tissue_cannot_exert_is_never_valid(model: Path, data: Dataset) -> None:
    rewritten(unit_n=lambda a: a * 1e6)(model)
    answers = load_model(model).predict(data)
    assert not any(answer.valid for answer in answers)
    assert "more than 10 N: the image or the actuation is unlike the training data, or the" in answers[0].detail


def test_an_actuation_unlike_the_training_data_is_not_answered(model: Path, data: Dataset) -> None:
    stream = load_model(model).start(data.session_info["s0"])
    first = next(iter(data.observations()))
    for knob, status in (
        (10.0, "valid"),
        (9.0, "valid"),
        (13.1, "valid"),
        (13.3, "out_of_distribution"),
        (1e3, "out_of_distribution"),
    ):
        answer = stream.update(replace(first, actuation={"knob_deg": knob}))
        assert answer.status == status, (knob, answer.detail)
    assert answer.detail == "the actuation is unlike the training data (knob_deg 1000, the limits are 8.8 and 13.2)"
    signed_again(model, lambda manifest: manifest["state"].pop("actuation_limits"))  # as it was saved before
    stream = load_model(model).start(data.session_info["s0"])
    assert stream.update(replace(first, actuation={"knob_deg": 14.0})).valid
    answer = stream.update(replace(first, actuation={"knob_deg": 1e3}))
    assert answer.status == "out_of_distribution", "what it was trained with is not known, but no knob stands there"
    assert answer.detail == "knob_deg 1000 is no such reading: expected -720 to 720 degrees"


@pytest.mark.parametrize("extra", [{}, {"linear": 1.0, "scaling": "standard"}], ids=["thesis", "linear"])
def test_the_onnx_graph_answers_the_same(data: Dataset, tmp_path: Path, extra: dict[str, Any]) -> None:
    svr = create("svr", {**QUICK, **extra}).fit(data)
    facts = export_onnx(svr, tmp_path / "svr.onnx")
    assert facts["parity_n"] < 1e-6
    assert facts["features"] == ["A1", "A2", "A3", "A4", "A5", "knob_deg"]
    shapes = [o.views["camera"].values for o in data.observations()]  # type: ignore[union-attr]
    rows = np.column_stack([shapes, data.actuation["knob_deg"]])
    session = onnxruntime.InferenceSession(tmp_path / "svr.onnx", providers=["CPUExecutionProvider"])
    assert np.max(np.abs(session.run(None, {"features": rows})[0] - forces(svr, data)[:, :2])) < 1e-9


def test_a_missing_extra_names_the_install_line(data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    svr = create("svr", QUICK).fit(data)
    monkeypatch.setitem(__import__("sys").modules, "onnx", None)
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[onnx\]'"):
        export_onnx(svr, tmp_path / "svr.onnx")
    assert list(tmp_path.glob("*.onnx")) == []
