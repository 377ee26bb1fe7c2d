"""From the knob to the curvature: play, hysteresis, tendon. All are independent of speed and keep their state."""

from ._hysteresis import Hysteresis, Play, PrandtlIshlinskii
from ._knob import KnobMap, Tendon

__all__ = ["Hysteresis", "KnobMap", "Play", "PrandtlIshlinskii", "Tendon"]
