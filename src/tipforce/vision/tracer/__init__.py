"""Sub-pixel tracing of a catheter's centreline.

Only the pixels around the two flanks of the shaft are read. A frame takes these steps: entries on the base line
(`_entries`), tracing of the shaft (`_trace`), a smooth axis (`_spline`), its tip (`_tip`, `_known_length`,
`_tip_template`), its continuation beyond the end of the trace (`_continuation`, on a `_strip`). `_solve` does all of
this for one candidate, and `_tracer` decides whether the result is the catheter.
"""

from ._tip_template import TEMPLATE_COLUMNS, TEMPLATE_ROWS, TEMPLATE_WIDTH
from ._tracer import Trace, Tracer

__all__ = ["TEMPLATE_COLUMNS", "TEMPLATE_ROWS", "TEMPLATE_WIDTH", "Trace", "Tracer"]
