"""Server of the live page: a small web server that sends one message per frame, and at most one at a time to a page."""

from ._hub import PageState
from ._server import LOCAL_HOST, PageServer, PageSink, serve
from ._settings import Commands, PageSettings
from ._tip_force import TipForce, tip_force

__all__ = [
    "LOCAL_HOST",
    "Commands",
    "PageServer",
    "PageSettings",
    "PageSink",
    "PageState",
    "TipForce",
    "serve",
    "tip_force",
]
