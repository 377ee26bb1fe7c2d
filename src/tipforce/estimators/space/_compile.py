"""Compilation of the kernels of this package: they are compiled again after a change in any of its files."""

from ..._system.compilation import compiled_together

compiled = compiled_together(__file__, "_*.py")
