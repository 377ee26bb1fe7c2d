"""The page on methods of other packages: its code is installed as a package, and every verb is given its commands."""

from pathlib import Path

import numpy as np
import pytest

from tipforce.datasets import open_dataset
from tipforce.errors import InputError
from tipforce.estimators import ESTIMATORS, load_model, method

from .conftest import code_blocks, install, type_command  # type: ignore[import-not-found]

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "add-a-method.md"
MOST_LINES = 25
"""Lines of a method whose inputs are the shape and the drives."""


@pytest.fixture
def ridge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The code of the page, installed: a module and what `pip install` writes beside it."""
    text = PAGE.read_text(encoding="utf-8")
    code, project = code_blocks(text, "python")[0], code_blocks(text, "toml")[0]
    install(tmp_path / "site", "tipforce-ridge", project, ESTIMATORS, monkeypatch)
    (tmp_path / "site" / "tipforce_ridge.py").write_text(code, encoding="utf-8")
    return code


def test_a_method_on_the_shape_takes_a_few_lines(ridge: str) -> None:
    assert len(ridge.splitlines()) <= MOST_LINES


def test_every_command_of_the_page_works_with_a_method_of_another_package(
    ridge: str, work_folder: Path, no_figures: None
) -> None:
    for path in (work_folder / "runs").glob("session_0[2-7]*"):  # copies; two sessions suffice
        path.unlink()
    commands = [line for line in code_blocks(PAGE.read_text(encoding="utf-8"), "console")[0].splitlines() if line]
    assert [line.split()[1] for line in commands] == ["train", "evaluate", "estimate", "live"]
    printed = {line.split()[1]: type_command(line) for line in commands}
    for verb, text in printed.items():
        print(f"$ {next(line for line in commands if line.split()[1] == verb)}\n{text}")
    assert "6 numbers a frame" in printed["train"]
    assert "error over folds" in printed["train"]
    assert "interval from: " in printed["train"]
    assert "Report: report/report.html" in printed["evaluate"]
    card = (work_folder / "models" / "ridge" / "README.md").read_text(encoding="utf-8")
    assert "# ridge: force at a catheter's tip from images" in card
    assert "| fx |" in card
    assert "A1, A2, A3, A4, A5, knob_deg" in card
    data = open_dataset(work_folder / "run.mcap")
    some = data.subset(np.arange(0, len(data), 50))
    model = load_model(work_folder / "models" / "ridge")
    assert model.settings.weight == 0.001
    found = model.predict(some)
    assert sum(each.valid for each in found) > 0.5 * len(found)
    assert [each.magnitude_n for each in found] == pytest.approx(
        [each.magnitude_n for each in load_model(work_folder / "models" / "ridge").predict(some)], nan_ok=True, abs=0
    )
    assert (work_folder / "forces.csv").read_text(encoding="utf-8").count(",valid,") > 0.5 * len(data)


def test_a_package_that_cannot_be_imported_hinders_nobody_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = 'lost = "no_such_module:Lost"\n'
    install(tmp_path, "broken", f'[project.entry-points."tipforce.estimators"]\n{points}', ESTIMATORS, monkeypatch)
    assert method("svr").name == "svr"
    assert "lost" in ESTIMATORS
    with pytest.raises(InputError, match=r"method 'lost' of the package broken 0\.1 cannot be loaded from no_such_mod"):
        method("lost")


def test_two_packages_with_one_name_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(
        tmp_path, "other", '[project.entry-points."tipforce.estimators"]\nsvr = "json:loads"\n', ESTIMATORS, monkeypatch
    )
    with pytest.raises(InputError, match=r"tipforce and other 0\.1 both have a method 'svr'; uninstall one"):
        method("svr")


def test_what_is_no_method_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = 'loads = "json:loads"\nanother = "tipforce.estimators.svr:Svr"\n'
    install(tmp_path, "wrong", f'[project.entry-points."tipforce.estimators"]\n{points}', ESTIMATORS, monkeypatch)
    with pytest.raises(InputError, match=r"wrong 0\.1: json:loads is no class derived from Estimator"):
        method("loads")
    with pytest.raises(InputError, match=r"the method 'another' is .*Svr, whose name is 'svr'; set name = 'another'"):
        method("another")
