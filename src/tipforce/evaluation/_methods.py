"""The methods that are evaluated: saved models and methods by name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ..datasets import Dataset
from ..errors import InputError
from ..estimators import (
    ESTIMATORS,
    Estimator,
    FineTunable,
    create,
    for_dataset,
    initial_model_folder,
    load_initial_model,
    load_model,
    located,
    read_manifest,
)
from ..types import views_text


@dataclass(frozen=True, eq=False)
class Method:
    """A method that is evaluated.

    Attributes:
        label: Its name in the report.
        estimator: Trained anew on every split.
        saved: A fitted model, scored as it is on the sessions that are not in ``trained_sessions``; None for a method
            that was named.
        trained_sessions: Fingerprints of the sessions that the saved model was trained on (names, where a model was
            made before these were kept), or, where ``estimator`` is fine-tuned from a model's weights, that model's.
        trained_fingerprint: Fingerprint of the data that the saved model was trained on.
        initial_sha256: Checksum of the model whose weights ``estimator`` is fine-tuned from; empty without one.
    """

    label: str
    estimator: Estimator
    saved: Estimator | None = None
    trained_sessions: frozenset[str] = frozenset()
    trained_fingerprint: str = ""
    initial_sha256: str = ""

    def for_dataset(self, dataset: Dataset) -> "Method":
        """Returns the method for the views of ``dataset``. Raises InputError where it reads a view that is absent."""
        saved = None if self.saved is None else for_dataset(self.saved, dataset)
        estimator = saved.unfitted() if saved is not None else for_dataset(self.estimator, dataset)
        return replace(self, estimator=estimator, saved=saved)

    @property
    def as_it_comes(self) -> Estimator | None:
        """The estimator that is scored without any training: the saved model, or a method that needs none."""
        return self.saved or (None if self.estimator.needs_fit else self.estimator)


def methods_from(
    models: Sequence[str], settings: Mapping[str, BaseModel] | None = None, init_from: str | None = None
) -> list[Method]:
    """Makes a `Method` of each name.

    Args:
        models: Folders of saved models, ``pretrained/NAME``, or names of methods such as ``svr``.
        settings: Method -> its settings; default settings where absent. A saved model keeps its own.
        init_from: Model whose weights the named methods start from in every split; they must be networks of its kind.

    Returns:
        The methods in the order of ``models``. Labels are names of folders, or whole paths where two names are equal.

    Raises:
        InputError: A name is neither a model nor a method.
        ModelError: A folder holds no whole model.
    """
    methods: list[Method] = []
    for model in models:
        folder = located(model)
        if folder.is_dir() and (model not in ESTIMATORS or (folder / "model.json").is_file()):
            methods.append(_saved(model))
        elif model in ESTIMATORS:
            estimator = _learning_from_the_rest(create(model, (settings or {}).get(model)))
            initial = load_initial_model(estimator, init_from)
            if isinstance(estimator, FineTunable) and initial is not None:
                estimator = estimator.fine_tuned_from(initial)
            folder = None if init_from is None else initial_model_folder(estimator, init_from)
            methods.append(
                Method(
                    model,
                    estimator,
                    trained_sessions=initial.training_sessions if initial else estimator.training_sessions,
                    initial_sha256="" if folder is None else str(read_manifest(folder)["sha256"]["model.json"]),
                )
            )
        else:
            listed = ", ".join(ESTIMATORS)
            raise InputError(
                f"{model}: is neither the folder of a saved model nor a method; the methods are {listed}, "
                "and `tipforce train DATA -o FOLDER` saves a model"
            )
    labels = [method.label for method in methods]
    if len(set(labels)) < len(labels):
        # Two folders of the same name differ by their whole paths.
        methods = [replace(method, label=str(Path(model))) for model, method in zip(models, methods, strict=True)]
    return methods


def view_notes(methods: Sequence[Method], dataset: Dataset) -> list[str]:
    """Returns a sentence for each method on the views that it reads, where the data have several.

    Args:
        methods: the methods, for the views of ``dataset``.
        dataset: the evaluated samples.
    """
    if len(dataset.views) < 2:
        return []
    read = {method.label: (method.as_it_comes or method.estimator).views for method in methods}
    return [
        f"{label} reads {views_text(views)} of the views {', '.join(dataset.views)}."
        for label, views in read.items()
        if set(views) <= set(dataset.views)
    ]


def _learning_from_the_rest(estimator: Estimator) -> Estimator:
    """Returns the method with settings that let it train although samples have no shape: they count as abstained."""
    settings = estimator.settings
    if "max_left_out" not in type(settings).model_fields or "max_left_out" in settings.model_fields_set:
        return estimator
    return estimator.with_settings(settings.model_copy(update={"max_left_out": 1.0}))


def _saved(folder: str) -> Method:
    """Returns the method of a saved model; calibration and fine-tuning sessions count as trained ones, too."""
    fitted = load_model(folder)
    training = read_manifest(folder).get("training", {})
    return Method(
        label=Path(folder).resolve().name if Path(folder).exists() else folder,
        estimator=fitted.unfitted(),
        saved=fitted,
        trained_sessions=_identifiers(training)
        | _identifiers(training.get("calibration", {}))
        | fitted.training_sessions,
        trained_fingerprint=str(training.get("fingerprint", "")),
    )


def _identifiers(part: Mapping[str, Any]) -> frozenset[str]:
    """Returns the fingerprints of the sessions of a manifest's ``part``; the names of those without one."""
    fingerprints: Mapping[str, str] = part.get("session_fingerprints", {})
    return frozenset(fingerprints.get(name, name) for name in part.get("sessions", ()))
