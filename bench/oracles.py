"""``python -m bench.oracles``: every published or exact solution that checks the rod models, in one table.

Columns: expected, got, error, tolerance. ``--part NAME`` selects a part; the random loads take a minute. Fails where an
error exceeds its tolerance.
"""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from bench.machine import machine
from bench.oracle_rows import QUICK, SLOW, Row
from threadpoolctl import threadpool_limits


def show(rows: list[Row]) -> None:
    print(f"{'oracle':58} {'model':38} {'expected':>13} {'got':>13} {'error':>9} {'allowed':>9}")
    for r in rows:
        mark = "" if r.holds else "  DOES NOT HOLD"
        print(f"{r.oracle:58} {r.model:38} {r.expected:13.8g} {r.got:13.8g} {r.error:9.2g} {r.tolerance:9.2g}{mark}")


def main() -> None:
    parts = {**QUICK, **SLOW}
    parser = argparse.ArgumentParser(prog="python -m bench.oracles", description=__doc__)
    parser.add_argument("--part", nargs="+", choices=parts, default=list(parts), metavar="NAME", help=", ".join(parts))
    parser.add_argument("--json", type=Path, default=Path("build/oracles.json"), help="where the figures go")
    chosen = parser.parse_args()
    rows: list[Row] = []
    with threadpool_limits(1):
        for name in chosen.part:
            found = list(parts[name]())
            if not found:
                print(f"{name}: left out, PyElastica is not installed (pip install -e '.[oracle]')")
            rows += found
    show(rows)
    wrong = sum(not r.holds for r in rows)
    print(f"{len(rows)} rows, {wrong} do not hold")
    chosen.json.parent.mkdir(parents=True, exist_ok=True)
    figures = {"machine": machine(), "rows": [{**asdict(r), "holds": r.holds} for r in rows]}
    chosen.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    if wrong:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
