"""What `import tipforce` gives, and what the command line asks of people."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

import tipforce
from tipforce.cli import VERBS, app
from tipforce.errors import InputError

SOURCE = Path(tipforce.__file__).parent
COMMON = {"output", "overwrite", "json_file", "json", "settings", "data", "bench", "executor"}
"""Options that every verb of the kind has: where to write, --set, --json; what is read, and the bench that it is of."""


def test_every_public_name_is_there_and_documented() -> None:
    for name in tipforce.__all__:
        value = getattr(tipforce, name)
        if name != "__version__":
            assert value.__doc__, name
    assert set(tipforce.__all__) <= set(dir(tipforce))
    with pytest.raises(AttributeError, match="no attribute 'Estimate'"):
        _ = tipforce.Estimate


@pytest.mark.parametrize("name", ["estimate", "evaluate", "import_session", "inspect", "simulate", "train"])
def test_jobs_state_their_arguments_and_errors(name: str) -> None:
    text = getattr(tipforce, name).__doc__
    assert "Args:" in text
    assert "Raises:" in text


def test_importing_loads_nothing_heavy() -> None:
    heavy = ("numpy", "scipy", "numba", "cv2", "pydantic", "typer", "torch", "onnxruntime", "matplotlib", "sklearn")
    code = f"import sys, tipforce; print([m for m in {heavy!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_has_at_most_ten_options_of_its_own(verb: str) -> None:
    command = get_command(app).commands[verb]  # type: ignore[attr-defined]
    own = [p.name for p in command.params if p.param_type_name == "option" and p.name not in COMMON]
    assert len(own) <= 10, own


def messages(path: Path) -> list[tuple[int, str]]:
    """Texts of a module that are no docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and node.body
        and isinstance(node.body[0], ast.Expr)
    }  # fmt: skip
    whole = [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]
    parts = {id(part) for node in whole for part in ast.walk(node) if part is not node}
    texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    found = [(node.lineno, str(node.value)) for node in texts if id(node) not in docs | parts]
    return found + [(node.lineno, ast.unparse(node)) for node in whole]


def test_the_library_s_messages_name_parameters_not_options() -> None:
    wrong = [
        f"{path.relative_to(SOURCE)}:{line}: {text}"
        for path in sorted(SOURCE.rglob("*.py"))
        if path.parent.name != "cli" and path.parts[-2:] != ("pipelines", "_demo.py")
        for line, text in messages(path)
        if re.search(r"(?<![\w`-])--[a-z][a-z-]+", text) and "tipforce " not in text
    ]
    assert not wrong


def test_images_without_stamps_are_estimated_on() -> None:
    frames = [np.full((480, 640), 128, np.uint8)] * 3
    found = list(tipforce.estimate("pretrained/dcfe", frames, frame_rate_hz=50.0))
    assert [each.stamp_ns for each in found] == [0, 20_000_000, 40_000_000]


def test_metadata_beside_an_open_source_are_refused_not_ignored(bench: Path) -> None:
    with tipforce.open_recording(bench / "runs" / "session_00.mcap") as source:
        found = tipforce.estimate("pretrained/dcfe", source, bench=bench / "session_00" / "bench.toml")
        with pytest.raises(InputError, match="state bench and actuation when it is opened"):
            next(found)
