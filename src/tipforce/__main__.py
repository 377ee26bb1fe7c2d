"""``tipforce`` and ``python -m tipforce``: signals are looked after before anything heavy is imported."""

import atexit
import os
import signal
import sys

from ._system.processes import ENDING, Interrupted, ending_signals, signals_end_the_program

_INTERRUPTED = {128 + each for each in ENDING}


def main() -> None:
    """Runs the command line; an interrupt at any moment, also while it is loaded, is one sentence."""
    try:
        with signals_end_the_program():
            from .cli import main as run

            run()
    except Interrupted as stop:  # before the verb had begun
        sys.stderr.write(f"tipforce: stopped by {stop.signal.name}\n")
        _leave(128 + stop.signal)
    except SystemExit as end:
        if isinstance(end.code, int) and end.code in _INTERRUPTED:
            _leave(end.code)
        raise
    finally:  # what comes now is the end of the interpreter
        for each in ending_signals():
            signal.signal(each, signal.SIG_DFL)


def _leave(code: int) -> None:
    """Ends the process without freeing all that is loaded, which takes a second more.

    All files are cleaned up and all children have ended when an interrupt comes to here.
    """
    atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]  (multiprocessing gives its semaphores back)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # whoever read it has gone
            continue
    os._exit(code)


if __name__ == "__main__":
    main()
