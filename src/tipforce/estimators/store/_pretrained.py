"""Models that come with the program, named ``pretrained/NAME``."""

from pathlib import Path

from ...errors import ModelError

PRETRAINED = Path(__file__).parents[1] / "pretrained"
"""Folder with one model folder for each, in the format of the store."""


def pretrained_names() -> tuple[str, ...]:
    """Returns the names of the models, in the order of the alphabet."""
    return tuple(sorted(path.parent.name for path in PRETRAINED.glob("*/model.json")))


def pretrained_folder(name: str) -> Path:
    """Returns the model folder of a pretrained model. Raises ModelError for an unknown name."""
    names = pretrained_names()
    if name not in names:
        there = ", ".join(f"pretrained/{each}" for each in names) or "none"
        raise ModelError(f"pretrained/{name}: no such model comes with this program; there are: {there}")
    return PRETRAINED / name


def located(model: str | Path) -> Path:
    """Returns the folder of a model: ``model`` itself, or that of ``pretrained/NAME`` if there is no such folder here.

    Raises:
        ModelError: there is no pretrained model of this name.

    >>> located("models/svr").as_posix()
    'models/svr'
    """
    folder = Path(model)
    parts = folder.parts
    if len(parts) == 2 and parts[0] == "pretrained" and not folder.exists():
        return pretrained_folder(parts[1])
    return folder
