"""How the kernels of the planar rod are compiled: a change in any of its files counts."""

from ..._system.compilation import compiled_together

compiled = compiled_together(__file__, "_*.py")
