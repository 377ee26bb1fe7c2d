"""The short run as fixtures."""

from ..short_run import recording, run  # type: ignore[import-not-found]

__all__ = ["recording", "run"]
