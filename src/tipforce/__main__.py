"""``tipforce`` and ``python -m tipforce``: signals are handled before the large modules are imported."""

import atexit
import os
import signal
import sys

from ._system.processes import ENDING, Interrupted, ending_signals, signals_end_the_program

_INTERRUPTED = {128 + each for each in ENDING}


def main() -> None:
    """Runs the command line; an interrupt at any moment, even while it is loaded, prints one sentence."""
    try:
        with signals_end_the_program():
            from .cli import main as run

            run()
    except Interrupted as stop:  # before the command had begun
        sys.stderr.write(f"tipforce: stopped by {stop.signal.name}\n")
        _leave(128 + stop.signal)
    except SystemExit as end:
        if isinstance(end.code, int) and end.code in _INTERRUPTED:
            _leave(end.code)
        raise
    finally:  # from here on only the interpreter ends
        for each in ending_signals():
            signal.signal(each, signal.SIG_DFL)


def _leave(code: int) -> None:
    """Ends the process without freeing all loaded modules, which takes a second more.

    When an interrupt reaches this point, all files are cleaned up and all children have ended.
    """
    atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]  (multiprocessing gives its semaphores back)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # the reader of the stream has gone
            continue
    os._exit(code)


if __name__ == "__main__":
    main()
