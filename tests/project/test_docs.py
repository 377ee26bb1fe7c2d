"""What is written down is true: verbs, links, and nothing that belongs to one machine."""

import ast
import importlib
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import tipforce
from tipforce.cli import VERBS, app

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = get_command(app).commands  # type: ignore[attr-defined]
MAX_WORDS_IN_DOCS = 35_000
"""Without ``docs/archive``; the bars of tables count as words."""
MAX_WORDS_IN_LOG_LINE = 41
"""40 and the dash before them."""
MAX_README_LINES = 120
MAX_CHANGELOG_LINES_OF_A_VERSION = 80


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_has_help_with_an_example_and_stands_in_the_readme(verb: str) -> None:
    result = CliRunner().invoke(app, [verb, "--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert result.exit_code == 0
    assert f"tipforce {verb}" in result.output.split("Example", 1)[-1], "the help of each verb shows an example"
    assert f"tipforce {verb}" in (ROOT / "README.md").read_text(encoding="utf-8")


def documents() -> list[Path]:
    """Returns the current documents; ``docs/archive`` is history, whose links and commands may be void."""
    named = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
    archive = ROOT / "docs" / "archive"
    pages = [page for page in sorted((ROOT / "docs").rglob("*.md")) if archive not in page.parents]
    return [*(ROOT / name for name in named), *pages]


def test_the_documents_stay_short() -> None:
    pages = [page for page in documents() if page.is_relative_to(ROOT / "docs")]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= MAX_WORDS_IN_DOCS
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= MAX_README_LINES
    log = (ROOT / "docs" / "log.md").read_text(encoding="utf-8").splitlines()
    assert not [line for line in log if len(line.split()) > MAX_WORDS_IN_LOG_LINE]
    versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.M)
    assert max(len(version.splitlines()) for version in versions) <= MAX_CHANGELOG_LINES_OF_A_VERSION


def anchors(document: Path) -> set[str]:
    """What a link may name of ``document``: its headings, written as GitHub does."""
    headings = re.findall(r"^#+ (.+)$", document.read_text(encoding="utf-8"), flags=re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", documents(), ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(document: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)[^)]*\)|src=\"([^\"]+)\"", document.read_text(encoding="utf-8"))
    broken: list[str] = []
    for link in (a or b for a, b in links):
        if link.startswith(("http", "mailto")) or "reference/" in link:  # generated: the site's build checks them
            continue
        name, _, anchor = link.partition("#")
        target = document.parent / name if name else document
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


def test_commands_named_in_the_docs_exist() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.M))
    for document in documents():
        text = document.read_text(encoding="utf-8")
        code = "\n".join(re.findall(r"```[a-z]*\n(.*?)```", text, flags=re.S) + re.findall(r"`([^`\n]+)`", text))
        verbs = set(re.findall(r"(?:^|[\s/])tipforce ([a-z][a-z-]*)", code))
        assert verbs <= set(VERBS), f"{document.name} names verbs that do not exist"
        made = set(re.findall(r"(?:^|\n)make ([a-z]+)", code))
        assert made <= targets, f"{document.name} names make targets that do not exist"


def test_files_and_benchmarks_named_in_the_docs_exist() -> None:
    for document in documents():
        text = document.read_text(encoding="utf-8")
        paths = set(re.findall(r"\b(?:bench|docs|tests|src|scripts)/[\w/]+\.(?:py|sh|md)\b", text))
        named = re.findall(r"python -m bench\.([\w.]*\w)", text)
        paths |= {f"bench/{name.replace('.', '/')}.py" for name in named}
        assert not [path for path in paths if not re.search("[A-Z]", path) and not (ROOT / path).is_file()], (
            document.name
        )


def written_commands() -> list[tuple[str, str]]:
    """Where, and the command line: fenced code of the documents, examples of the verbs' help, longer inline code."""
    found = [(verb, line) for verb, command in COMMANDS.items() for line in (command.help or "").split("\n")]
    for document in documents():
        text = document.read_text(encoding="utf-8")
        fenced = "\n".join(re.findall(r"```[a-z]*\n(.*?)```", text, flags=re.S)).split("\n")
        inline = [code for code in re.findall(r"`([^`\n]+)`", text) if len(code.split()) > 4]
        found += [(document.name, line) for line in (*fenced, *inline)]
    written = [(place, line.strip().removeprefix("Example: ")) for place, line in found]
    typed = [(place, line) for place, line in written if re.match(r"tipforce [a-z][a-z-]* .", line)]
    return [(place, line) for place, line in typed if not any(word.isupper() for word in line.split())]  # SEED: a gap


@pytest.mark.parametrize(("place", "line"), written_commands())
def test_a_command_that_is_written_down_can_be_typed(place: str, line: str) -> None:
    verb, *words = shlex.split(line, comments=True)[1:]
    assert COMMANDS[verb].make_context(verb, words).command is COMMANDS[verb], place


@pytest.mark.parametrize("model", ["compact", "compact-wide", "dcfe"])
def test_the_commands_that_made_the_shipped_models_can_be_typed(model: str, tmp_path: Path) -> None:
    recorder = tmp_path / "tipforce"
    recorder.write_text('#!/bin/sh\nprintf "%s\\037" "$@"\nprintf "\\036"\n', encoding="utf-8")
    recorder.chmod(0o755)
    script = ["bash", str(ROOT / "scripts" / "train_pretrained.sh"), model]
    path = f"{tmp_path}:{os.environ['PATH']}"
    ran = subprocess.run(script, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=True)
    commands = [command.split("\037")[:-1] for command in ran.stdout.split("\036")[:-1]]
    assert len(commands) >= 6
    for verb, *words in commands:
        assert COMMANDS[verb].make_context(verb, words).command is COMMANDS[verb]


def python_examples() -> list[tuple[str, str]]:
    found = [(path, re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.S)) for path in documents()]
    return [(str(path.relative_to(ROOT)), code) for path, codes in found for code in codes]


@pytest.mark.parametrize(("place", "code"), python_examples())
def test_names_that_python_examples_import_exist(place: str, code: str) -> None:
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tipforce"):
            module = importlib.import_module(node.module or "")
            assert not [alias.name for alias in node.names if not hasattr(module, alias.name)], place
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "tipforce":
            assert hasattr(tipforce, node.attr), f"{place}: tipforce.{node.attr}"


def test_nothing_belongs_to_one_machine() -> None:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout, or git is not installed")
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    forbidden = re.compile(r"/(?:work|root|home)/[a-z]|pypi\.org|files\.pythonhosted|registry\.npmjs|deb\.debian\.org")
    for name in filter(None, tracked.stdout.split("\0")):
        path = ROOT / name
        if path == Path(__file__) or not path.is_file() or path.suffix in {".png", ".mp4", ".npz", ".onnx"}:
            continue
        assert not forbidden.search(path.read_text(encoding="utf-8", errors="replace")), name


@pytest.mark.skipif(
    not all((ROOT / "src" / "tipforce" / part).is_dir() for part in ("live", "hardware", "control")),
    reason="what the page of hazards names is not all here",
)
def test_each_test_that_the_documents_name_exists() -> None:
    named = {name for page in documents() for name in re.findall(r"`(test_\w+)`", page.read_text(encoding="utf-8"))}
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    assert len(named) > 40
    assert not named - set(re.findall(r"^def (test_\w+)\(", tests, flags=re.M))
