"""Images of the simulated bench: camera and fluoroscope, and their common parts."""

__all__: list[str] = []
