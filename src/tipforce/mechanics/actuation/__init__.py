"""From the knob to the curvature: play, hysteresis, the tendon; all independent of speed, with their memory inside."""

from ._knob import KnobMap
from ._play import Hysteresis, Play
from ._prandtl_ishlinskii import PrandtlIshlinskii
from ._tendon import Tendon

__all__ = ["Hysteresis", "KnobMap", "Play", "PrandtlIshlinskii", "Tendon"]
