"""The scripts of bench/ that draw what is to be seen."""

import importlib.util
import pathlib
import sys
from types import ModuleType

import numpy as np

from tipforce.types import Status
from tipforce.vision import Tracer, VisionSettings

ROOT = pathlib.Path(__file__).parents[2]


def load(name: str) -> ModuleType:
    """A script of bench/, by its path."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "bench" / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def judge(look: object, seeds: range, settings: VisionSettings) -> tuple[int, int]:
    """Tubes that are seen rightly, and tubes that are seen wrongly but called valid."""
    tubes = load("tubes")
    right = wrong = 0
    for seed in seeds:
        tube = tubes.draw(np.random.default_rng(seed), look)
        sight = Tracer(settings).detect(tube.image)
        if sight.centreline is None:
            assert sight.status in (Status.CUT_OFF, Status.NO_CATHETER)
            continue
        away = tubes.distance_to_curve(sight.centreline.points, tube.curve).max()
        fine = away < 2 and abs(tubes.tip_along(sight.centreline.points, tube)) < 5
        right += fine
        wrong += not fine
    return right, wrong
