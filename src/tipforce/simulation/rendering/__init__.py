"""Images of the simulated bench: camera and fluoroscope, and what both share."""

__all__: list[str] = []
