"""The model store: a folder with ``model.json``, ``arrays.npz``, a model card and the method's own files.

It is written whole or not at all. The SHA-256 of every file is checked, except for the card, which people may edit.
"""

import hashlib
import json
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from ..._system.json_files import read_json
from ..._system.npz import read_npz
from ...datasets import Dataset
from ...errors import FileFormatError, InputError, ModelError
from ...io import replacing_folder
from .._base import Estimator
from .._registry import ESTIMATORS
from ..networks import check_graph_file, try_graph
from ._card import model_card
from ._pretrained import PRETRAINED, located, pretrained_folder

FORMAT_VERSION = 2
"""Version of the model folder's format; other versions are not read."""

MAX_MANIFEST_BYTES, MAX_FILE_BYTES = 64 << 20, 1 << 30
"""Largest ``model.json``, and largest of the other files; those that come with the program have 0.3 and 22 MB."""

MANIFEST, ARRAYS, CARD = "model.json", "arrays.npz", "README.md"
_OBJECTS = ("settings", "state", "sha256", "training", "facts")
_UNFIT = (ArithmeticError, AttributeError, AssertionError, LookupError, TypeError, ValueError)
"""Errors of a method whose state and arrays do not fit each other."""


def save_model(
    estimator: Estimator,
    folder: str | Path,
    training: Dataset,
    metrics: Mapping[str, Any] | None = None,
    *,
    calibration: Dataset | None = None,
    overwrite: bool = False,
) -> Path:
    """Writes a fitted method as a model folder, whole or not at all; returns the folder.

    Args:
        estimator: the fitted method.
        folder: the folder.
        training: the samples that it was fitted on, for the manifest.
        metrics: figures to keep with it, JSON values.
        calibration: the separate sessions of its intervals, for the manifest.
        overwrite: whether an existing model is replaced; other folders never are.

    Raises:
        InputError: ``folder`` exists and may not be replaced.
        NotFittedError: the method is not fitted.
        ModelError: the method cannot be saved.
    """
    folder = Path(folder)
    check_target(folder, overwrite=overwrite)
    values, arrays = estimator.state()
    files = estimator.files()
    if unfit := [name for name in files if not _is_own(name)]:
        raise ValueError(f"{estimator.name}: no names for files of a model folder: {', '.join(unfit)}")
    with replacing_folder(folder) as part:
        with (part / ARRAYS).open("wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)
        for name, data in files.items():
            (part / name).write_bytes(data)
        manifest = _manifest(estimator, training, calibration, metrics, values)
        (part / CARD).write_text(model_card(estimator, manifest), encoding="utf-8")
        manifest["sha256"] = {name: _sha256((part / name).read_bytes()) for name in (ARRAYS, CARD, *files)}
        manifest["sha256"][MANIFEST] = _own_sha256(manifest)
        text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False)
        (part / MANIFEST).write_text(text + "\n", encoding="utf-8")
    return folder


def check_target(folder: str | Path, *, overwrite: bool = False) -> None:
    """Checks whether a model can be written, before a training of minutes.

    Args:
        folder: the model folder.
        overwrite: whether an existing model may be replaced.

    Raises:
        InputError: it cannot be written.
    """
    folder = Path(folder)
    if not folder.exists():
        return
    if not overwrite:
        raise InputError(f"{folder}: exists already; choose another name or state overwrite=True")
    if not (folder / MANIFEST).is_file() and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder}: is no model folder, so overwrite=True does not replace it; choose another name")


def _facts_of(data: Dataset) -> dict[str, Any]:
    """Returns the manifest's entry of a dataset: title, checksums, size and sessions."""
    return {
        "title": data.title,
        "fingerprint": data.fingerprint(),
        "samples": len(data),
        "sessions": list(data.sessions),
        "session_fingerprints": dict(data.session_fingerprints),
    }


def _manifest(
    estimator: Estimator,
    training: Dataset,
    calibration: Dataset | None,
    metrics: Mapping[str, Any] | None,
    values: dict[str, Any],
) -> dict[str, Any]:
    """Returns the content of ``model.json`` without the checksums; for the arguments see `save_model`.

    ``values`` are the JSON values of the method's state.
    """
    frames = sorted(training.force_frames)
    return {
        "format": "tipforce model",
        "format_version": FORMAT_VERSION,
        "method": estimator.name,
        "settings": estimator.settings.model_dump(mode="json"),
        "units": {"force": "N", "stamp": "ns", "actuation": "as named"},
        "frame_of_forces": frames[0] if len(frames) == 1 else frames,
        "state": values,
        "facts": estimator.describe().model_dump(mode="json"),
        "training": {
            **_facts_of(training),
            **({} if calibration is None else {"calibration": _facts_of(calibration)}),
            "simulated": all(info.simulated for info in training.session_info.values()),
            "force_range_n": [float(np.min(training.magnitude_n)), float(np.max(training.magnitude_n))],
        },
        "metrics": dict(metrics or {}),
        "versions": {
            "tipforce": version("tipforce"),
            "python": platform.python_version(),
            "numpy": version("numpy"),
            "scikit-learn": version("scikit-learn"),
            "onnxruntime": version("onnxruntime"),
        },
        "seed": getattr(estimator.settings, "seed", None),
    }


def load_model(folder: str | Path, view: str | None = None) -> Estimator:
    """Returns the estimator in ``folder``.

    Args:
        folder: a path, ``pretrained/NAME``, or the name of a method that needs no fit.
        view: the view that it shall read, in place of its own.

    Raises:
        InputError: a view is stated for a method that does not read one.
        ModelError: a file is missing or altered, the model is newer than this program, or its method is unknown.
    """
    method = _loaded(located(folder))
    return method if view is None else method.reading(view)


def _loaded(folder: Path) -> Estimator:
    """Returns the method in a model folder, or an unfitted method that needs no fit if ``folder`` is its name.

    A graph that did not come with this program is checked and run in a separate process first: it may be harmful.

    Raises:
        ModelError: a file is missing, altered or harmful, or does not fit the method.
    """
    named = ESTIMATORS.get(str(folder))
    if named is not None and not named.needs_fit and not (folder / MANIFEST).exists():
        return named()
    manifest = read_manifest(folder)
    sums = manifest["sha256"]
    contents = {name: _checked(folder, name, sums[name]) for name in sums if name not in (MANIFEST, CARD)}
    files = {name: data for name, data in contents.items() if _is_own(name)}
    try:
        arrays = read_npz(contents[ARRAYS], ARRAYS, "train the model again or copy the whole folder")
        if unfit := [name for name, array in arrays.items() if array.dtype.kind not in "biufU"]:
            raise ValueError(f"the array {unfit[0]} holds no numbers")
        for name in files:
            if name.endswith(".onnx"):
                check_graph_file(files[name], name)
                if folder.parent != PRETRAINED:
                    try_graph(folder / name)
        kind, settings = ESTIMATORS[manifest["method"]], manifest["settings"]
        if folder.parent == PRETRAINED:  # for every bench: the view of the training data does not count
            settings = {key: value for key, value in settings.items() if key != kind.view_setting}
        return kind.from_state(settings, manifest["state"], arrays, files)
    except _UNFIT as error:
        held = ", ".join([MANIFEST, ARRAYS, *files])
        raise ModelError(
            f"{folder}: the content of its files ({held}) does not fit the method {manifest['method']} "
            f"({_first_of(error)}); train the model again"
        ) from None
    except InputError as error:
        raise ModelError(f"{folder}: {error}") from None


def _first_of(error: Exception) -> str:
    """Returns an error in one short line; where several values are wrong, the first one."""
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(str(part) for part in first['loc'])}={str(first['input'])[:80]}: {first['msg']}"
    return str(error).splitlines()[0][:200] if str(error) else type(error).__name__


def load_pretrained(name: str) -> Estimator:
    """Returns a model that comes with this program. Raises ModelError for an unknown name."""
    return load_model(pretrained_folder(name))


def _checked(folder: Path, name: str, expected: str) -> bytes:
    """Returns the content of a file of a model folder, after a check that it is unchanged."""
    path = folder / name
    if not path.is_file():
        raise ModelError(f"{folder}: the file {name} is missing; train the model again or copy the whole folder")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ModelError(
            f"{path}: has {path.stat().st_size} bytes, more than the {MAX_FILE_BYTES >> 20} MiB that a file of a model "
            "may have; train the model again or copy the whole folder"
        )
    data = path.read_bytes()
    if _sha256(data) != expected:
        raise ModelError(
            f"{path}: was altered or cut off after it was saved (its SHA-256 is not the one in {MANIFEST}); "
            "train the model again or copy the whole folder"
        )
    return data


def _is_own(name: str) -> bool:
    """Returns whether ``name`` is a further file of the method, within the folder."""
    return name not in (MANIFEST, ARRAYS, CARD) and Path(name).name == name and not name.startswith(".")


def read_manifest(folder: str | Path) -> dict[str, Any]:
    """Reads ``model.json`` of ``folder``, or of ``pretrained/NAME``.

    Raises:
        ModelError: it is missing, unreadable, altered or newer than this program, or its method is unknown.
    """
    folder = located(folder)
    path = folder / MANIFEST
    if not path.is_file():
        raise ModelError(f"{folder}: is no model folder, there is no {MANIFEST}; make one with `tipforce train`")
    try:
        manifest = read_json(path, max_bytes=MAX_MANIFEST_BYTES)
        stored_version = manifest["format_version"]
        lacking = {"method", *_OBJECTS} - set(manifest)
        wrong = [name for name in _OBJECTS if not isinstance(manifest.get(name, {}), dict)]
    except FileFormatError as error:
        raise ModelError(f"{error}; train the model again or copy the whole folder") from None
    except (KeyError, TypeError):
        raise ModelError(f"{path}: is damaged; train the model again or copy the whole folder") from None
    if not isinstance(stored_version, int) or stored_version > FORMAT_VERSION:
        raise ModelError(
            f"{path}: has the format version {stored_version}, this program reads version {FORMAT_VERSION}; update "
            f"tipforce (this is {version('tipforce')}) or train the model again"
        )
    if stored_version < FORMAT_VERSION:
        raise ModelError(
            f"{path}: has the older format version {stored_version}, this program reads version {FORMAT_VERSION}; "
            "train the model again"
        )
    if lacking:
        raise ModelError(f"{path}: lacks {', '.join(sorted(lacking))}; train the model again or copy the whole folder")
    if wrong:
        raise ModelError(
            f"{path}: {wrong[0]} is no list of named values; train the model again or copy the whole folder"
        )
    if not isinstance(manifest["method"], str) or manifest["method"] not in ESTIMATORS:
        raise ModelError(
            f"{path}: was made by the method {manifest['method']!r}, this program has {', '.join(ESTIMATORS)}; update "
            "tipforce, or train the model with a method that is there"
        )
    sums: dict[str, Any] = manifest["sha256"]
    if unfit := [name for name in sums if name not in (MANIFEST, ARRAYS, CARD) and not _is_own(name)]:
        raise ModelError(f"{path}: names the file {unfit[0]!r}, which is not in a model folder; train the model again")
    if not {ARRAYS, MANIFEST} <= set(sums) or sums[MANIFEST] != _own_sha256(manifest):
        raise ModelError(
            f"{path}: was altered after it was saved (its SHA-256 is not the one it states); train the model again or "
            "copy the whole folder"
        )
    return manifest


def _own_sha256(manifest: Mapping[str, Any]) -> str:
    """Returns the SHA-256 of the content of ``model.json`` except for this sum itself, independent of its layout."""
    others = {name: value for name, value in manifest["sha256"].items() if name != MANIFEST}
    text = json.dumps({**manifest, "sha256": others}, sort_keys=True, ensure_ascii=False)
    return _sha256(text.encode())


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
