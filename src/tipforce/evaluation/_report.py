"""The report folder: ``report.html`` that needs nothing beside it, ``metrics.json``, figures as SVG."""

import json
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from ..errors import InputError
from ..io import replacing_folder
from ._evaluation import Evaluation
from ._gallery import worst_frames
from ._numbers import FILTERS
from ._picture import Picture
from ._pictures import bound_picture, disturbed_picture, method_pictures, overview
from ._summary import summary

__all__ = ["check_folder", "write_report"]

_OURS = {"report.html", "metrics.json", "figures"}


def write_report(evaluation: Evaluation, folder: str | Path, command: str = "") -> dict[str, Any]:
    """Write the report to ``folder``, whole or not at all, and return what its ``metrics.json`` holds.

    ``command``: what was typed to make it. A folder that holds an earlier report is replaced; one that holds anything
    else raises InputError.
    """
    folder = Path(folder)
    check_folder(folder)
    figures = summary(evaluation, command)
    head, bound, shaken = overview(evaluation), bound_picture(evaluation), disturbed_picture(evaluation)
    labels = [candidate.label for candidate in evaluation.candidates]
    drawn = {label: method_pictures(evaluation, label) for label in labels}
    sections = {label: {"pictures": drawn[label], "cards": worst_frames(evaluation, label)} for label in labels}
    template = _environment().get_template("report.html")
    page = template.render(r=figures, overview=head, bound=bound, shaken=shaken, sections=sections)
    pictures = [*filter(None, (head, bound, shaken)), *(picture for made in drawn.values() for picture in made)]
    with replacing_folder(folder) as fresh:
        _fill(fresh, page, figures, pictures)
    return figures


def check_folder(folder: str | Path) -> None:
    """Raises InputError where a report cannot be written to ``folder``: ask before training for minutes."""
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file, and the report needs a folder; choose another name with -o")
    strange = sorted({item.name for item in folder.iterdir()} - _OURS) if folder.is_dir() else []
    if strange:
        raise InputError(
            f"{folder}: holds {strange[0]!r}, which is no part of a report; choose an empty folder with -o"
        )


def _fill(folder: Path, page: str, figures: dict[str, Any], pictures: list[Picture]) -> None:
    (folder / "figures").mkdir()
    for picture in pictures:
        (folder / "figures" / f"{picture.slug}.svg").write_text(picture.file, encoding="utf-8")
    text = json.dumps(figures, indent=2, allow_nan=False, ensure_ascii=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
    (folder / "report.html").write_text(page, encoding="utf-8")


def _environment() -> Environment:
    """Templates that escape what comes from files, with the page's ways of writing numbers."""
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
