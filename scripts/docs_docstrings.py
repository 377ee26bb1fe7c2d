"""Prepares docstrings for the documentation site: doctests and literal blocks become code blocks (Griffe extension)."""

import re
from typing import Any

import griffe

DOCTEST = re.compile(r"^(?P<indent>[ ]*)>>> .*(?:\n(?P=indent)\S.*)*", flags=re.M)


class CodeBlocks(griffe.Extension):
    """Converts the code examples of docstrings to Markdown."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called for every object that was read."""
        if obj.docstring:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(text: str) -> str:
    """The text with fenced doctests, and without the colons that introduce literal blocks in reStructuredText."""
    text = re.sub(r"^::\n", "", text, flags=re.M)
    text = re.sub(r"(?<=\S)::$", ":", text, flags=re.M)
    return DOCTEST.sub(lambda found: _fenced(found[0], found["indent"]), text)


def _fenced(code: str, indent: str) -> str:
    return f"{indent}```pycon\n{code}\n{indent}```"
