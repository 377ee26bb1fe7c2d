"""The model store: saved models, those that come with the program, and the run directory of a training."""

from ._card import training_lines
from ._pretrained import located, pretrained_names
from ._run_directory import initial_model_folder, load_initial_model, run_directory, training_started
from ._store import FORMAT_VERSION, check_target, load_model, load_pretrained, read_manifest, save_model

__all__ = [
    "FORMAT_VERSION",
    "check_target",
    "initial_model_folder",
    "load_initial_model",
    "load_model",
    "load_pretrained",
    "located",
    "pretrained_names",
    "read_manifest",
    "run_directory",
    "save_model",
    "training_lines",
    "training_started",
]
