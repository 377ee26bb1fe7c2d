"""The run directory of a network's training, and the model that it is fine-tuned from."""

import shutil
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from ..._system.locks import output_lock
from ...errors import InputError
from ...training import CHECKPOINT_FILE
from .._base import Estimator, FineTunable
from ._store import MANIFEST, load_model


def load_initial_model(method: Estimator, start: str | None, *, resume: bool = False) -> FineTunable | None:
    """Returns the model that a training starts from.

    Args:
        method: the method to train.
        start: folder of the model, or "pretrained" for the one of that method that comes with the program; None: none.
        resume: whether the training continues from a checkpoint.

    Raises:
        InputError: ``method`` is no network, or the model is of another method.
    """
    if (start is not None or resume) and not isinstance(method, FineTunable):
        option = "resume" if resume else "init_from"
        raise InputError(f"{option} is for networks; {method.name} always learns from nothing, so leave it out")
    if start is None:
        return None
    model = load_model(initial_model_folder(method, start))
    if not isinstance(model, FineTunable) or model.name != method.name:
        raise InputError(f"init_from={start}: is a {model.name}, and {method.name} cannot start from its weights")
    return model


def initial_model_folder(method: Estimator, start: str) -> str:
    """Returns the folder of an initial model.

    Args:
        method: the method that starts from it.
        start: a folder, or "pretrained" for the model of this method that comes with the program.
    """
    return f"pretrained/{method.name}" if start == "pretrained" and not (Path(start) / MANIFEST).is_file() else start


_RESUME = "go on with it by resume=True"


@contextmanager
def run_directory(method: Estimator, model: Path, *, resume: bool, advice: str = _RESUME) -> Generator[Path | None]:
    """Yields the folder MODEL.training, for prepared images, checkpoint and log; None for other methods.

    It is removed when the block ends without an error. After an error or a kill it is kept if it has a checkpoint.

    Args:
        method: the method to train.
        model: the model folder.
        resume: continue the training in the folder.
        advice: the next step, for the warning that the folder is kept; empty: no warning.

    Raises:
        InputError: the folder exists and ``resume`` is False, or the reverse, or it contains other files than those of
            a training.
    """
    if not isinstance(method, FineTunable):
        yield None
        return
    with output_lock(model):
        yield from _locked(method, model, resume, advice)


def _locked(method: FineTunable, model: Path, resume: bool, advice: str) -> Generator[Path | None]:
    """Checks, makes, yields and removes the run directory, while the model's folder is locked; see `run_directory`."""
    folder = _folder(model)
    if resume and not folder.is_dir():
        raise InputError(f"there is nothing to resume: {folder} does not exist; leave out resume=True")
    if not resume and training_started(model):
        raise InputError(
            f"{folder}: holds a training that was not finished; continue it with resume=True, or remove the folder"
        )
    entries = list(folder.iterdir()) if folder.is_dir() else []
    unexpected = [
        path.name for path in entries if not path.is_file() or path.name.removesuffix(".part") not in method.run_files
    ]
    if unexpected:
        raise InputError(
            f"{folder}: is the run directory of this training, but it holds other things ({min(unexpected)}); choose "
            "another name for the model, or move the folder"
        )
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield folder
    except BaseException:  # an interrupt by the keyboard, too
        if not training_started(model):
            shutil.rmtree(folder)
        elif advice:
            warnings.warn(f"{folder} keeps the training so far; {advice}", stacklevel=4)
        raise
    shutil.rmtree(folder)


def training_started(model: Path) -> bool:
    """Returns whether a training of ``model`` was interrupted and left a checkpoint."""
    return (_folder(model) / CHECKPOINT_FILE).is_file()


def _folder(model: Path) -> Path:
    return model.with_name(f"{model.name}.training")
