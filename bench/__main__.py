"""``python -m bench``: the speed of everything that has a target, in one run, beside the plain way of each.

Prints tables, writes build/bench.json. ``--part NAME ...`` chooses; each part can be run alone too.
"""

import argparse
import time
from importlib import import_module
from pathlib import Path

from bench.parts import PARTS, one_thread, save


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS), metavar="NAME", help=", ".join(PARTS))
    parser.add_argument("--json", type=Path, default=Path("build/bench.json"), help="where the figures go")
    chosen = parser.parse_args()
    one_thread()
    from bench.machine import machine

    about = machine()
    print(f"{about['cpu']}, Python {about['python']}, NumPy {about['numpy']}, Numba {about['numba']}; best blocks\n")
    figures = {}
    for name in chosen.part:
        part, began = import_module(PARTS[name]), time.perf_counter()
        figures[name] = part.measure()
        part.show(figures[name])
        print(f"({name}: {time.perf_counter() - began:.0f} s)\n", flush=True)
    save(chosen.json, figures)


if __name__ == "__main__":
    main()
