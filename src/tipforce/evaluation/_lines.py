"""The report in a few lines of text, for the terminal."""

from typing import Any

from ._constant import Constant
from ._numbers import FILTERS

__all__ = ["report_lines"]

_HEAD = ("", "MAE g", "MAE mN", "RMSE mN", "max mN", "bias mN", "R2", "coverage %", "refused %")


def report_lines(figures: dict[str, Any]) -> list[str]:
    """Verdict, notes and the table of scores, from what `write_report` or `summary` returns."""
    mn, grams, fixed, share = (FILTERS[name] for name in ("mn", "grams", "fixed", "share"))
    table: list[tuple[str, ...]] = []
    protocol = ""
    for row in figures["rows"]:
        if row["protocol_text"] != protocol:
            protocol = row["protocol_text"]
            table.append((f"{protocol}:",))
        scores = row["against_sensor"]
        m = scores["quantities"]["magnitude"]
        name = "constant predictor" if row["method"] == Constant.name else row["method"]
        table.append(
            (
                f"  {name}",
                grams(m["mae_g"]),
                mn(m["mae_n"]),
                mn(m["rmse_n"]),
                mn(m["max_n"]),
                mn(m["bias_n"]),
                fixed(m["r2"], 2),
                share(m["coverage"]),
                share(scores["refused_share"]),
            )
        )
    first = max(len(cells[0]) for cells in table)
    lines = [_line(_HEAD, first), *(_line(cells, first) for cells in table)]
    return [
        " ".join(figures["verdict"]),
        *figures["notes"],
        "",
        *lines,
        "",
        *_bound_lines(figures),
        *_disturbed_lines(figures),
    ]


def _bound_lines(figures: dict[str, Any]) -> list[str]:
    """Each method's error over the smallest possible under the strictest protocol, and what that takes for unknown."""
    if figures["bound"] is None:
        return []
    fixed, lines = FILTERS["fixed"], list[str]()
    for row in figures["rows"]:
        held = row["against_bound"]
        if held is None or row["protocol"] != figures["strictest_protocol"] or row["method"] == Constant.name:
            continue
        ratios = [
            f"{fixed(held[way]['magnitude']['all']['ratio'], 2)} ({name})"
            for way, name in figures["bound"]["ways"].items()
        ]
        lines.append(f"{row['method']}, magnitude, error over the smallest possible: {', '.join(ratios)}")
    return [*lines, *figures["bound"]["nuisances"], ""]


def _disturbed_lines(figures: dict[str, Any]) -> list[str]:
    """Each method's error under the largest disturbance of each kind."""
    if figures["disturbed"] is None:
        return []
    mn, share, said = FILTERS["mn"], FILTERS["share"], list[str]()
    for method, (plain, *lines) in figures["disturbed"].items():
        largest = {line["kind"]: line for line in lines}
        told = [
            f"{kind} {line['size']} {mn(line['mae_n'])} ({share(line['refused_share'])} % refused)"
            for kind, line in largest.items()
            if "," not in kind
        ]
        said.append(
            f"{method}, disturbed, MAE in mN: none {mn(plain['mae_n'])}, {', '.join(told)}; "
            f"a constant {mn(plain['constant']['mae_n'])}"
        )
    return [*said, ""]


def _line(cells: tuple[str, ...], first: int) -> str:
    rest = "".join(cell.rjust(max(9, len(head) + 2)) for cell, head in zip(cells[1:], _HEAD[1:], strict=False))
    return (cells[0].ljust(first) + rest).rstrip()
