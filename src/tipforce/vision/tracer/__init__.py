"""Sub-pixel tracing of a catheter's centreline.

Only the pixels around the two flanks of the shaft are read. A frame takes these steps: entries on the base line and
tracing of the shaft (`_trace`), a smooth axis (`_spline`), its tip (`_tip`, `_known_length`, `_tip_template`), what
continues beyond it (`_continuation`, on a `_strip`), all of it for one candidate (`_solve`), and the decision whether
the result is the catheter (`_tracer`). Where a session's shaft comes out of a sheath is found beforehand (`_mouth`).
"""

from ._mouth import Mouth, base_box, find_mouths
from ._tip_template import TEMPLATE_COLUMNS, TEMPLATE_ROWS, TEMPLATE_WIDTH
from ._tracer import Trace, Tracer

__all__ = ["TEMPLATE_COLUMNS", "TEMPLATE_ROWS", "TEMPLATE_WIDTH", "Mouth", "Trace", "Tracer", "base_box", "find_mouths"]
