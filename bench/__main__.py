"""``python -m bench``: how fast a frame becomes a force; prints a table, writes build/bench.json."""

import argparse
import json
import os
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--blocks", type=int, default=8, help="how often the ways are timed in turn")
    parser.add_argument("--json", default="build/bench.json", help="where the figures go")
    chosen = parser.parse_args()
    # Before anything that starts threads is imported.
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    import cv2
    from bench.speed import LOOKS, SIZES, machine, make_case, measure

    cv2.setNumThreads(1)
    console = Console(stderr=True)
    results = []
    for size in SIZES:
        for name in LOOKS:
            result = measure(make_case(name, size), chosen.blocks, console.print)
            results.append(result)
            show(result)
    figures = {"machine": machine(), "results": results}
    target = Path(chosen.json)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    about = figures["machine"]
    print(f"{about['cpu']}, one thread, Python {about['python']}, NumPy {about['numpy']}, Numba {about['numba']}")
    console.print(f"wrote {target}")


def show(result: dict) -> None:
    width, height = result["size"]
    table = Table(title=f"{result['frames']}, {width}x{height} RGB, pool of {result['pool_mib']} MiB")
    for column, side in (("", "left"), ("p50 us", "right"), ("p99 us", "right"), ("best block p50", "right")):
        table.add_column(column, justify=side)
    for name, row in result["times"].items():
        table.add_row(name, *(f"{row[key]:.1f}" for key in ("p50_us", "p99_us", "best_block_p50_us")))
    Console(file=sys.stdout, width=90).print(table)
    ratio = result["textbook_over_force"]
    book = (
        "the textbook chain does not see this shape"
        if ratio is None
        else f"{ratio:.0f} x faster than the textbook chain"
    )
    print(f"frame -> force: {result['force_over_read']:.2f} x reading once; {book}")
    print(
        f"force on {100 * result['valid']:.0f} % of the frames; shape lost in {100 * result['lost']:.0f} %, "
        f"by the textbook chain in {100 * result['textbook_lost']:.0f} %\n"
    )


if __name__ == "__main__":
    main()
