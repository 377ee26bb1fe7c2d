"""Closed-loop control of the tip force: controllers, supervision, and the safety layer in front of the drives."""

from ._controllers import Admittance, Controller, PeriodicRejection, ProportionalIntegral, Still, make_controller
from ._loop import ControlLoop, ControlState, ControlTick
from ._observer import Sample, WallObserver
from ._path import Path
from ._safety import Applied, SafetyAction, SafetyLayer
from ._settings import CONTROLLERS, LIFTED_LIMIT_N, ControllerName, ControlSettings, ObserverSettings, SafetySettings

__all__ = [
    "CONTROLLERS",
    "LIFTED_LIMIT_N",
    "Admittance",
    "Applied",
    "ControlLoop",
    "ControlSettings",
    "ControlState",
    "ControlTick",
    "Controller",
    "ControllerName",
    "ObserverSettings",
    "Path",
    "PeriodicRejection",
    "ProportionalIntegral",
    "SafetyAction",
    "SafetyLayer",
    "SafetySettings",
    "Sample",
    "Still",
    "WallObserver",
    "make_controller",
]
