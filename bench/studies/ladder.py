"""The ladder: methods against splits and presets in one table, out of the reports of `tipforce evaluate`.

    tipforce evaluate constant svr ... --data RUNS --truth RUNS --every 24 -o REPORT
    python -m bench.studies.ladder REPORT ...

Magnitude against the truth; a line for each preset, method and split, and the constant once for each split.
"""

import argparse
import json
import math
import pathlib


def row(preset: str, result: dict) -> list[str]:
    """Cells of one result of a metrics.json."""
    judged = result["against_truth"]
    found, trust = judged["quantities"]["magnitude"], judged["trust"]
    contact = judged["by_contact"]["contact"]["quantities"]["magnitude"]
    over = (result.get("against_bound") or {}).get("all_frames", {}).get("magnitude", {}).get("all", {})
    n = found.get("n", 0)

    def mn(part: dict, name: str) -> str:
        value = part.get(name)
        return "-" if value is None or not math.isfinite(value) else f"{1e3 * value:.0f}"

    def share(value: float | None) -> str:
        return "-" if value is None or not math.isfinite(value) else f"{100 * value:.0f}"

    ratio = over.get("rms_ratio")
    return [
        preset,
        result["method"],
        result["protocol"],
        *(mn(found, name) for name in ("mae_n", "rmse_n", "max_n", "bias_n")),
        mn(contact, "mae_n"),
        f"{found['r2']:.2f}" if n else "-",
        share(found.get("coverage")),
        share(trust.get("wrong_share")),
        share(judged["abstained_share"]),
        "-" if ratio is None else f"{ratio:.1f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reports", nargs="+", type=pathlib.Path)
    rows: dict[tuple[str, ...], list[str]] = {}
    for report in parser.parse_args().reports:
        metrics = json.loads((report / "metrics.json").read_text())
        for result in metrics["results"]:
            groups = result["against_truth"]["trust"].get("by_group", [])
            cells = row("; ".join(group["group"] for group in groups), result)
            rows.setdefault(tuple(cells[:3]), cells)
    names = ("preset", "method", "split", "MAE", "RMSE", "max", "bias", "MAE in contact", "R^2", "held", "wrong")
    print("| " + " | ".join((*names, "abstained", "over bound")) + " |")
    print("|---" * 13 + "|")
    for key in sorted(rows):
        print("| " + " | ".join(rows[key]) + " |")


if __name__ == "__main__":
    main()
