"""Where a network's training stands while it runs, and what it begins with."""

import shutil
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError
from ..training import CHECKPOINT_FILE
from ._base import Estimator, FineTunable
from .store import MANIFEST, load_model

__all__ = ["load_initial_model", "run_directory"]


def load_initial_model(recipe: Estimator, start: str | None, *, resume: bool = False) -> FineTunable | None:
    """The model that training is to begin with: the folder ``start``, None where that is None.

    ``start`` may be "pretrained": the one of that method that comes with the program.
    Raises InputError where ``recipe`` is no network, or the model is of another method.
    """
    if (start is not None or resume) and not isinstance(recipe, FineTunable):
        option = "resume" if resume else "init_from"
        raise InputError(f"{option} is for networks; {recipe.name} always learns from nothing, so leave it out")
    if start is None:
        return None
    if start == "pretrained" and not (Path(start) / MANIFEST).is_file():
        start = f"pretrained/{recipe.name}"
    model = load_model(start)
    if not isinstance(model, FineTunable) or model.name != recipe.name:
        raise InputError(f"init_from={start}: is a {model.name}, and {recipe.name} cannot start from its weights")
    return model


@contextmanager
def run_directory(recipe: Estimator, model: Path, *, resume: bool) -> Generator[Path | None]:
    """The folder MODEL.training beside ``model``, for prepared pictures, checkpoint and log; None for other methods.

    It goes when the block ends well. What ends it otherwise, a kill too, leaves it to be resumed once there is a
    checkpoint. Raises InputError where it is there already and ``resume`` is False, or is not and it is True, and
    where it holds anything that no training left there.
    """
    if not isinstance(recipe, FineTunable):
        yield None
        return
    folder = model.with_name(f"{model.name}.training")
    if resume and not folder.is_dir():
        raise InputError(f"there is nothing to resume: {folder} does not exist; leave out resume=True")
    if not resume and (folder / CHECKPOINT_FILE).is_file():
        raise InputError(
            f"{folder}: holds a training that was not finished; go on with it by resume=True, or remove the folder"
        )
    there = list(folder.iterdir()) if folder.is_dir() else []
    strange = [
        path.name for path in there if not path.is_file() or path.name.removesuffix(".part") not in recipe.run_files
    ]
    if strange:
        raise InputError(
            f"{folder}: is where the training would work, and holds other things ({min(strange)}); choose another name "
            "for the model, or move the folder"
        )
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield folder
    except BaseException:
        if (folder / CHECKPOINT_FILE).is_file():
            warnings.warn(f"{folder} keeps the training so far; go on with it by resume=True", stacklevel=3)
        else:
            shutil.rmtree(folder)
        raise
    shutil.rmtree(folder)
