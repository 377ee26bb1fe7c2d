"""The report folder: ``report.html`` that needs nothing beside it, ``metrics.json``, figures as SVG."""

import json
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from ...errors import InputError
from ...io import replacing_folder
from .._evaluate import Evaluation
from ._drawings import HEAD, head_drawings, method_drawings, traces_of
from ._gallery import worst_frames
from ._style import Drawing
from ._summary import summary
from ._text import FILTERS

_PARTS = {"report.html", "metrics.json", "figures"}


def write_report(evaluation: Evaluation, folder: str | Path, command: str = "") -> dict[str, Any]:
    """Writes ``report.html``, ``metrics.json`` and ``figures/*.svg``, all or nothing.

    Args:
        evaluation: Result of `evaluate`.
        folder: Folder of the report; an earlier report there is replaced.
        command: The command that makes it.

    Returns:
        The content of ``metrics.json``, see `summary`.

    Raises:
        InputError: ``folder`` holds something that is no part of a report.
    """
    folder = Path(folder)
    check_report_folder(folder)
    metrics = summary(evaluation, command)
    best, traces = metrics["best_method"], traces_of(evaluation)
    head = head_drawings(evaluation, best, traces)
    labels = [method.label for method in evaluation.methods]
    drawings = {label: method_drawings(evaluation, label, best, traces) for label in labels}
    sections = {label: {"drawings": drawings[label], "cards": worst_frames(evaluation, label)} for label in labels}
    page = (
        _environment().get_template("report.html").render(r=metrics, head=dict.fromkeys(HEAD) | head, sections=sections)
    )
    with replacing_folder(folder) as fresh:
        _fill(fresh, page, metrics, [*head.values(), *(each for section in drawings.values() for each in section)])
    return metrics


def check_report_folder(folder: str | Path) -> None:
    """Checks that a report can be written to ``folder``, before minutes of training.

    Raises InputError where ``folder`` is a file, or holds something that is no part of a report.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, and the report needs a folder; choose another name with -o")
    unexpected = sorted({item.name for item in folder.iterdir()} - _PARTS) if folder.is_dir() else []
    if unexpected:
        raise InputError(
            f"{folder}: holds {unexpected[0]!r}, which is no part of a report; choose an empty folder with -o"
        )


def _fill(folder: Path, page: str, metrics: dict[str, Any], drawings: list[Drawing]) -> None:
    (folder / "figures").mkdir()
    for drawing in drawings:
        (folder / "figures" / f"{drawing.slug}.svg").write_text(drawing.file, encoding="utf-8")
    text = json.dumps(metrics, indent=2, allow_nan=False, ensure_ascii=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
    (folder / "report.html").write_text(page, encoding="utf-8")


@cache
def _environment() -> Environment:
    """Returns templates that escape text from files, with filters that write numbers; compiled once a process."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(FILTERS)
    environment.filters["svg"] = Markup
    return environment
