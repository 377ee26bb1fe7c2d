"""Writes the pages of the documentation site that follow from the code, each time the site is built (MkDocs hooks).

- ``reference/commands.md``: every verb of the command line with its help, from the Typer app.
- ``reference/bench.md``: every value of ``bench.toml``.
- ``reference/api/*.md``: one page for each public package, with the names of its ``__all__``.
- ``changelog.md``, ``contributing.md``, ``security.md``: the files of the project's root.

It also completes the navigation: the tutorial appears as soon as ``docs/tutorial/`` holds a page.
"""

import importlib
import inspect
import pkgutil
import re
import sys
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))
from docs_docstrings import as_markdown

ROOT = Path(__file__).resolve().parents[1]
SOURCE_OF_PAGE = {"changelog.md": "CHANGELOG.md", "contributing.md": "CONTRIBUTING.md", "security.md": "SECURITY.md"}
ROOT_FILES_ON_SITE = {source: page for page, source in SOURCE_OF_PAGE.items()}

_BENCH_FILE = """Describes a bench, for all verbs (`--bench FILE`). `tipforce init-bench` writes it: remove the `#`
before a line and state your own value. A single value is stated with `--fact KEY=VALUE`, where the key begins with the
section, as in `--fact catheter.diameter_m=2.33e-3`."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Replaces the folders named in the navigation by their pages."""
    sections: dict[str, Any] = {
        "Reference": [
            {"Command line": "reference/commands.md"},
            {"bench.toml": "reference/bench.md"},
            {"Python": [{name.removeprefix("tipforce."): _api_page(name)} for name in public_packages()]},
        ],
    }
    navigation = [{title: sections.get(title, target)} for entry in config.nav or [] for title, target in entry.items()]
    if tutorial := [f"tutorial/{path.name}" for path in sorted((ROOT / "docs" / "tutorial").glob("*.md"))]:
        navigation.insert(1, {"Tutorial": tutorial})
    config.nav = navigation
    return config


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Adds the generated pages to those of ``docs/``."""
    pages = {"reference/commands.md": command_reference(), "reference/bench.md": bench_reference()}
    pages |= {_api_page(name): api_reference(name) for name in public_packages()}
    pages |= {page: root_page(source) for page, source in SOURCE_OF_PAGE.items()}
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: object) -> str:
    """Lets links to files of the project's root lead to their pages on the site."""
    up = "../" * page.file.src_uri.count("/")
    for source, target in ROOT_FILES_ON_SITE.items():
        markdown = markdown.replace(f"]({up}../{source}", f"]({up}{target}")
    return markdown


def root_page(name: str) -> str:
    """A Markdown file of the project's root, with its links as seen from ``docs/``."""
    text = (ROOT / name).read_text(encoding="utf-8")
    text = text.replace("](docs/", "](").replace("](README.md", "](index.md")
    for source, page in ROOT_FILES_ON_SITE.items():
        text = text.replace(f"]({source}", f"]({page}")
    return text


def command_reference() -> str:
    """Every verb's help as Markdown, in the order of the command line."""
    from typer.main import get_command

    from tipforce.cli import VERBS, app

    group: Any = get_command(app)
    parts = [
        "# Command line",
        f"{group.help} Generated from the program's own help.",
        "A verb ends with exit code 0 when it succeeds; with one sentence and code 2 when the input cannot be used.",
    ]
    for verb in VERBS:
        command = group.commands[verb]
        context = command.context_class(command, info_name=f"tipforce {verb}")
        parts += [f"## {verb}", *_help_text(command.help or "")]
        records = [record for parameter in command.params if (record := parameter.get_help_record(context))]
        parts.append("\n".join(["| parameter | meaning |", "|---|---|", *map(_table_row, records)]))
    return "\n\n".join(parts) + "\n"


def bench_reference() -> str:
    """Every value that ``bench.toml`` can hold, with its comment."""
    from tipforce.types import SessionInfo, bench_text

    return "\n\n".join(
        [
            "# bench.toml",
            _BENCH_FILE,
            f"```toml\n{bench_text(SessionInfo())}```",
        ]
    )


def _help_text(text: str) -> list[str]:
    """Paragraphs of a help text; examples become one block of code."""
    paragraphs: list[str] = []
    examples: list[str] = []
    for paragraph in re.split(r"\n\s*\n", text.replace("\b", "")):
        lines = [re.sub(r"^Examples?:\s*", "", line.strip()) for line in paragraph.strip().splitlines()]
        if commands := [line for line in lines if line.startswith("tipforce ")]:
            examples += commands
        elif remaining := " ".join(filter(None, lines)):
            paragraphs.append(_escape(remaining))
    if examples:
        paragraphs.append("\n".join(["```console", *examples, "```"]))
    return paragraphs


def _table_row(record: tuple[str, str]) -> str:
    names, meaning = (" ".join(text.split()) for text in record)
    return f"| `{names.replace('|', chr(92) + '|')}` | {_escape(meaning).replace('|', chr(92) + '|')} |"


def _escape(text: str) -> str:
    """Returns plain text as Markdown; text between backticks stays code."""
    parts = re.split(r"(`[^`]+`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([\\<>*_\[\]])", r"\\\1", part) for part in parts)


@cache
def public_packages() -> list[str]:
    """Names of ``tipforce`` and of its packages and modules with public names, sub-packages behind their parents."""
    root = importlib.import_module("tipforce")
    found = ["tipforce"]
    for module in pkgutil.walk_packages(root.__path__, "tipforce."):
        parts = module.name.split(".")[1:]
        hidden = any(part.startswith("_") for part in parts) or parts[0] == "cli"
        if hidden or not (module.ispkg or len(parts) == 1):
            continue
        if getattr(importlib.import_module(module.name), "__all__", ()):
            found.append(module.name)
    return found


def api_reference(name: str) -> str:
    """The page of one package: its docstring and every name of ``__all__``, each described on one page only."""
    module = importlib.import_module(name)
    described, elsewhere = [], []
    for member in (member for member in module.__all__ if not member.startswith("__")):
        home = _home(module, member)
        (described if home == name else elsewhere).append((member, home))
    parts = [f"# {name}", as_markdown((module.__doc__ or "").strip().replace("``", "`"))]
    if elsewhere:
        rows = [_elsewhere_row(module, member, home, _api_page(name)) for member, home in elsewhere]
        parts.append("\n".join(["| described elsewhere | |", "|---|---|", *rows]))
    return "\n\n".join([*parts, *(_api_entry(module, member) for member, _ in described)]) + "\n"


def _home(module: ModuleType, member: str) -> str:
    """The package on whose page a name is described.

    Functions of the public API are described with it, others in the innermost package that exports and defines them.
    """
    value = getattr(module, member)
    if not isinstance(value, type | FunctionType):
        return module.__name__
    if isinstance(value, FunctionType) and _exports(importlib.import_module("tipforce"), member, value):
        return "tipforce"
    exporting = [name for name in public_packages() if _exports(importlib.import_module(name), member, value)]
    around = [name for name in exporting if f"{value.__module__}.".startswith(f"{name}.") and name != "tipforce"]
    return max(around, key=len) if around else exporting[0]


def _exports(module: ModuleType, member: str, value: object) -> bool:
    return member in module.__all__ and getattr(module, member) is value


def _elsewhere_row(module: ModuleType, member: str, home: str, page: str) -> str:
    summary = (inspect.getdoc(getattr(module, member)) or "").split("\n", 1)[0].replace("``", "`")
    link = f"{'../' * (page.count('/'))}{_api_page(home)}"
    return f"| [{member}]({link}#{_definition(module, member)}) | {_escape(summary)} |"


def _api_entry(module: ModuleType, member: str) -> str:
    path = _definition(module, member)
    if not _is_found_in_source(path):  # a name made while the module is imported, as by unpacking a tuple
        return f"## {member}\n\n`{type(getattr(module, member)).__name__}`"
    return f"::: {path}\n    options:\n      heading: {member}\n      toc_label: {member}"


def _definition(module: ModuleType, member: str) -> str:
    value = getattr(module, member)
    if isinstance(value, type | FunctionType) and value.__module__.startswith("tipforce"):
        return f"{value.__module__}.{value.__qualname__}"
    return f"{module.__name__}.{member}"


@cache
def _source_tree() -> griffe.Object | griffe.Alias:
    return griffe.load("tipforce", search_paths=[ROOT / "src"])


def _is_found_in_source(path: str) -> bool:
    try:
        found = _source_tree()[path.removeprefix("tipforce.")]
        return not found.is_alias or found.final_target is not None
    except (KeyError, griffe.AliasResolutionError):
        return False


def _api_page(name: str) -> str:
    parts = name.split(".")
    return f"reference/api/{'/'.join(parts[1:]) or 'tipforce'}.md"
