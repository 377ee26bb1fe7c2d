"""From what a person names to what is judged: saved model folders and methods."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ..datasets import Dataset
from ..errors import InputError
from ..estimators import ESTIMATORS, NetworkEstimator, create, load_initial_model, load_model, located, read_manifest
from ..types import FloatArray, IntArray
from ._evaluation import Candidate
from ._stamps import values_at

__all__ = ["candidates_from", "truth_at"]


def candidates_from(
    models: Sequence[str], settings: Mapping[str, BaseModel] | None = None, start: str | None = None
) -> list[Candidate]:
    """A candidate for each of ``models``: a folder of a saved model, ``pretrained/NAME``, or the name of a method.

    ``settings``: method -> its settings, default where it is absent; a saved model keeps its own. ``start``: the model
    whose weights the methods that are named begin with, in every split; they must be networks of its kind. Raises
    InputError for what is neither, and ModelError for a folder that is no whole model.
    """
    made: list[Candidate] = []
    for model in models:
        if located(model).is_dir():
            made.append(_saved(model))
        elif model in ESTIMATORS:
            recipe = create(model, (settings or {}).get(model))
            begin = load_initial_model(recipe, start)
            if isinstance(recipe, NetworkEstimator) and begin is not None:
                recipe = recipe.fine_tuned_from(begin)
            made.append(Candidate(model, recipe, trained_sessions=begin.training_sessions if begin else frozenset()))
        else:
            known = ", ".join(ESTIMATORS)
            raise InputError(
                f"{model}: is neither the folder of a saved model nor a method; the methods are {known}, "
                "and `tipforce train DATA -o FOLDER` saves a model"
            )
    taken = [candidate.label for candidate in made]
    if len(set(taken)) < len(taken):
        # Two folders of the same name: told apart by their whole path.
        made = [Candidate(str(Path(model)), *_rest(each)) for model, each in zip(models, made, strict=True)]
    return made


def truth_at(dataset: Dataset, truths: Mapping[str, tuple[IntArray, FloatArray]]) -> FloatArray:
    """(n, 3): the true force of every sample, NaN where none is known.

    ``truths``: session -> stamps (m,) and forces (m, 3) in the base frame. Raises InputError where no sample has one.
    """
    remedy = "state as truth the folder that `tipforce simulate` wrote for these data"
    return values_at(dataset, truths, "truth", remedy)


def _saved(folder: str) -> Candidate:
    fitted = load_model(folder)
    training = read_manifest(folder).get("training", {})
    return Candidate(
        label=Path(folder).resolve().name if Path(folder).exists() else folder,
        recipe=fitted.unfitted(),
        saved=fitted,
        trained_sessions=_identifiers(training)
        | _identifiers(training.get("calibration", {}))
        | fitted.training_sessions,
        trained_fingerprint=str(training.get("fingerprint", "")),
    )


def _identifiers(part: Mapping[str, Any]) -> frozenset[str]:
    """Fingerprints of the sessions of a manifest's ``part``; the names of those of which none is kept."""
    fingerprints: Mapping[str, str] = part.get("session_fingerprints", {})
    return frozenset(fingerprints.get(name, name) for name in part.get("sessions", ()))


def _rest(candidate: Candidate) -> tuple[Any, ...]:
    return candidate.recipe, candidate.saved, candidate.trained_sessions, candidate.trained_fingerprint
