"""Models that come with the program, under the word ``pretrained/NAME``."""

from pathlib import Path

from ...errors import ModelError

PRETRAINED = Path(__file__).parents[1] / "pretrained"
"""Holds a model folder for each, as the store writes them."""


def pretrained_names() -> tuple[str, ...]:
    """Returns the names of the models, in the order of the alphabet."""
    return tuple(sorted(path.parent.name for path in PRETRAINED.glob("*/model.json")))


def pretrained_folder(name: str) -> Path:
    """The model folder of a pretrained model. Raises ModelError for a name that is none."""
    names = pretrained_names()
    if name not in names:
        there = ", ".join(f"pretrained/{each}" for each in names) or "none"
        raise ModelError(f"pretrained/{name}: no such model comes with this program; there are: {there}")
    return PRETRAINED / name


def located(model: str | Path) -> Path:
    """The folder that a person means: ``model`` itself, or the one of ``pretrained/NAME`` where that is no folder.

    Raises ModelError for a pretrained model that there is not.

    >>> located("models/svr").as_posix()
    'models/svr'
    """
    folder = Path(model)
    parts = folder.parts
    if len(parts) == 2 and parts[0] == "pretrained" and not folder.exists():
        return pretrained_folder(parts[1])
    return folder
