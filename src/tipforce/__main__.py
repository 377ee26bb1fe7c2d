"""``tipforce`` and ``python -m tipforce``: signals are looked after before anything heavy is imported."""

import signal
import sys

from ._processes import Interrupted, signals_end_the_program

__all__ = ["main"]


def main() -> None:
    """Runs the command line; an interrupt at any moment, also while it is loaded, is one sentence."""
    try:
        with signals_end_the_program():
            from .cli import main as run

            run()
    except Interrupted as stop:  # before the verb had begun
        sys.stderr.write(f"tipforce: stopped by {stop.signal.name}\n")
        sys.exit(128 + stop.signal)
    finally:  # what comes now is the end of the interpreter
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, signal.SIG_DFL)


if __name__ == "__main__":
    main()
