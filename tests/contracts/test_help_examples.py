"""Every example in every help text runs, in the order of a working day, in a folder with files of those names."""

import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.main import get_command

from tipforce.cli import VERBS, app
from tipforce.simulation import PRESETS

from .conftest import small  # type: ignore[import-not-found]
from .conftest import type_command as run  # type: ignore[import-not-found]

COMMANDS = get_command(app).commands  # type: ignore[attr-defined]


def examples(verb: str) -> list[str]:
    lines = [line.strip().removeprefix("Example:").strip() for line in (COMMANDS[verb].help or "").split("\n")]
    return [line for line in lines if line.startswith(f"tipforce {verb} ")]


def test_every_verb_has_examples() -> None:
    assert all(examples(verb) for verb in VERBS)


@pytest.mark.slow
def test_examples_of_simulate(work_folder: Path) -> None:
    shutil.rmtree(work_folder / "runs")
    for line in examples("simulate"):
        run(line)
    assert (work_folder / "runs" / "session_07.mcap").is_file()
    assert (work_folder / "set" / "metadata.csv").is_file()


@pytest.mark.slow
def test_examples_of_control(work_folder: Path) -> None:
    for line in examples("control"):
        run(line)
    assert (work_folder / "held" / "report.html").is_file()
    assert (work_folder / "run" / "recording.mcap").is_file()


@pytest.mark.parametrize("verb", ["init-bench", pytest.param("import", marks=pytest.mark.slow), "inspect"])
def test_examples_of(verb: str, work_folder: Path) -> None:
    for path in (work_folder / "runs").glob("session_0[2-7]*"):  # copies; two sessions suffice
        path.unlink()
    for line in examples(verb):
        output = work_folder / shlex.split(line)[-1]
        if verb != "inspect" and output.is_file():
            output.unlink()
        run(line)


def test_examples_of_annotate(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = sorted(path.name for path in (work_folder / "frames").iterdir())[:3]
    rows = [f"{name},{u},{v}" for name in names for u, v in ((10, 150), (100, 140), (200, 100))]
    (work_folder / "lines.csv").write_text("\n".join(["image,u,v", *rows]))
    trained = SimpleNamespace(folder=work_folder / "detector", seconds=1.0, left_out=())
    monkeypatch.setattr("tipforce.pipelines.AnnotationJob._fine_tune", lambda *_: trained)
    monkeypatch.setattr("tipforce.cli.annotate._wait", lambda _: None)  # nobody presses "Finish"
    for line in examples("annotate"):
        run(line)
    assert (work_folder / "run.annotations.json").is_file()
    assert (work_folder / "lines.json").is_file()


@pytest.mark.slow
def test_examples_of_train_evaluate_and_estimate(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.rmtree(work_folder / "runs")  # copies of two sessions; the examples name eight that differ
    # in smaller images a light contact moves the catheter by too little, in shorter sessions inertia stays unknown
    sessions_to_train_on = small("bench-2021", seconds=20.0, tare_s=5.0, size=(640, 480))
    monkeypatch.setitem(PRESETS, "bench-2021", sessions_to_train_on)
    for folder, seed, sessions in (("runs", 0, 8), ("bench", 1, 2), ("other", 2, 2)):
        run(f"tipforce simulate --preset bench-2021 --sessions {sessions} --seed {seed} -o {folder}/")
    for line in examples("train"):
        if line.endswith(" --resume"):
            cut_off(line.removesuffix(" --resume"), monkeypatch)
        run(f"{line} --overwrite")
    shutil.rmtree(work_folder / "models")
    run("tipforce train runs/ --estimator svr -o models/svr --set force=components")
    for line in (*examples("evaluate"), *examples("estimate")):
        run(line if line.startswith("tipforce evaluate") else f"{line} --overwrite")


def cut_off(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A training that ends after its last epoch, before the model is saved."""

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("cut off")

    with monkeypatch.context() as patch:
        patch.setattr("tipforce.pipelines._train.save_model", fail)
        with (
            pytest.warns(UserWarning, match="keeps the training so far"),
            pytest.raises(RuntimeError, match="cut off"),
        ):
            run(f"{line} --overwrite")
