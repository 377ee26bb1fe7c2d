"""Code and documents use plain English: no banned word in a docstring, a comment, a message or a page.

`python -m tests.project.test_language PATH...` lists the findings of files or folders, with the remedy for each.
The lists only grow.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "tipforce"

BANNED = {
    r"what\b(?![^.\n]*\?)": "name the thing: 'the measured offset', not 'what was measured'",
    r"(?:lies|lie|lay|stands|stand|stood)\b(?! still|-off\b)": "use 'is', or the verb that fits: 'ends', 'contains'",
    r"(?:tell|tells|told|telling)\b": "use 'state', 'show', 'distinguish'",
    r"(?:vouch\w*|believ\w*|contradict\w*|disagree\w*)": "use 'likelihood', 'weight', 'residual', 'differ'",
    r"doubt\w*": "use 'epistemic uncertainty', 'uncertain'",
    r"(?:sight|sighted|dent|dents|dented|familiar|lanes|octet|crew|untaught)\b": "use the term of the glossary",
    r"of late\b": "use 'recently', or the time in seconds",
    r"(?:hardly|scarcely)\b": "state the share or the limit",
    r"so (?:many|much|far) (?!that|as)": "state the quantity: 'at most N blocks'",
    r"it is not\b(?=[.;:,])": "complete the sentence",
    r"at once\b": "use 'immediately' or 'at the same time'",
    r"(?:whatever|whichever)\b": "name the cases",
}
"""Regular expressions of words that are not used, and the remedy."""

OPENINGS = {r"Of\b": "begin a docstring with a subject or a verb", r"As\b(?! )": "write a sentence"}
"""Words that no docstring begins with."""

_PATTERN = re.compile("|".join(rf"(?P<r{i}>\b{word})" for i, word in enumerate(BANNED)), re.IGNORECASE)
_REMEDIES = list(BANNED.values())


def _texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yields line number and text of every comment and string with a space (messages, docstrings) of a module."""
    strings = {tokenize.STRING, tokenize.COMMENT, getattr(tokenize, "FSTRING_MIDDLE", tokenize.COMMENT)}
    for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
        if token.type in strings and " " in token.string:
            yield token.start[0], token.string


def _pages(path: Path) -> Iterator[tuple[int, str]]:
    """Yields line number and text of a Markdown page, without its code."""
    fenced = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        fenced ^= line.lstrip().startswith("```")
        if not fenced and not line.startswith("    "):
            yield number, re.sub(r"`[^`]*`", "", line)


def findings(path: Path) -> list[str]:
    """Returns one line for each banned word of a module or a page: place, text, remedy."""
    found: list[str] = []
    for start, text in _texts(path) if path.suffix == ".py" else _pages(path):
        for match in _PATTERN.finditer(text):
            line = start + text.count("\n", 0, match.start())
            context = text[max(0, match.start() - 40) : match.end() + 30].replace("\n", " ")
            found.append(f"{path}:{line}: {match[0]!r} in '{context}': {_REMEDIES[int(str(match.lastgroup)[1:])]}")
    if path.suffix == ".py":
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            text = node.value.value if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) else None
            for opening, remedy in OPENINGS.items():
                if isinstance(text, str) and re.match(rf"\s*{opening}", text):
                    found.append(f"{path}:{node.lineno}: docstring begins with {text[:30]!r}: {remedy}")
    return found


def _files(paths: list[Path]) -> list[Path]:
    modules = [f for p in paths for f in (sorted(p.rglob("*.py")) + sorted(p.rglob("*.md")) if p.is_dir() else [p])]
    return [f for f in modules if "archive" not in f.parts]


def test_code_uses_plain_english() -> None:
    folders = (SOURCE, *(ROOT / name for name in ("bench", "benchmarks", "scripts")))
    found = [line for path in _files(list(folders)) for line in findings(path)]
    assert not found, found[:10]


def test_the_documents_use_plain_english() -> None:
    pages = [*_files([ROOT / "docs"]), *(ROOT / f for f in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"))]
    found = [line for page in pages for line in findings(page)]
    assert not found, found[:10]


def test_a_banned_word_is_found(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        '"""Of the tip."""\nx = 1  # what the rod is\ny = "Which way? What is asked?"\n', encoding="utf-8"
    )
    assert len(findings(module)) == 2


if __name__ == "__main__":
    listed = [line for path in _files([Path(a) for a in sys.argv[1:]]) for line in findings(path)]
    print("\n".join(listed))
    print(f"{len(listed)} findings")
