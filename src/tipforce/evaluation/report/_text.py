"""Numbers as text, for the page and the terminal, and the report in a few lines for the terminal."""

import json
import math
from collections.abc import Callable
from functools import partial
from typing import Any

from ...units import newtons_to_grams
from .._constant import Constant
from .._robustness import UNPERTURBED


def _number(value: float | None, digits: int, small_digits: int | None = None, small: float = 1.0) -> str:
    """Writes ``value`` with ``digits`` decimals, ``small_digits`` below ``small``.

    A missing value is a dash, and U+2212 is the minus.
    """
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits if small_digits is None or abs(value) >= small else small_digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _mn(newtons: float | None) -> str:
    return _number(_times(newtons, 1e3), 0, 1, 10.0)


def _grams(grams: float | None) -> str:
    return _number(grams, 1, 2)


def _newtons_as_grams(newtons: float | None) -> str:
    return _grams(None if newtons is None else newtons_to_grams(newtons))


def _interval(ends: list[float | None], text: Callable[[float], str]) -> str:
    low, high = ends
    return "–" if low is None or high is None else f"{text(low)} to {text(high)}"


def _newtons(newtons: float | None) -> str:
    return _number(newtons, 3, 4, 0.01)


def _share(share: float | None) -> str:
    return _number(_times(share, 100.0), 1)


def _facts(value: Any) -> str:
    """Writes nested facts on one line, numbers short."""
    if isinstance(value, dict):
        return ", ".join(f"{str(key).replace('_', ' ')} {_facts(item)}" for key, item in value.items())
    if isinstance(value, list):
        return " ".join(_facts(item) for item in value)
    return f"{value:.4g}" if isinstance(value, float) else "–" if value is None else str(value)


FILTERS: dict[str, Callable[..., str]] = {
    "mn": _mn,
    "mn_interval": partial(_interval, text=_mn),
    "g_interval": partial(_interval, text=_newtons_as_grams),
    "grams": _grams,
    "n_to_g": _newtons_as_grams,
    "newtons": _newtons,
    "percent": partial(_number, digits=1),
    "share": _share,
    "fixed": _number,
    "pretty": partial(json.dumps, indent=2, ensure_ascii=False),
    "facts": _facts,
}
"""Filters of the template: kind of value -> its text. A missing value is a dash."""

_HEAD = ("", "MAE g", "MAE mN", "95 % CI mN", "RMSE mN", "max mN", "bias mN", "R2", "coverage %", "abstained %")


def report_lines(metrics: dict[str, Any]) -> list[str]:
    """Returns the result of `write_report` or `summary` in lines of text: verdict, notes, the table of results."""
    mn, grams, fixed, share, interval = (FILTERS[name] for name in ("mn", "grams", "fixed", "share", "mn_interval"))
    table: list[tuple[str, ...]] = []
    protocol = ""
    for result in metrics["results"]:
        if result["protocol_text"] != protocol:
            protocol = result["protocol_text"]
            table.append((f"{protocol}:",))
        scores = result["against_sensor"]
        m = scores["quantities"]["magnitude"]
        name = "constant predictor" if result["method"] == Constant.name else result["method"]
        table.append((
            f"  {name}", grams(m["mae_g"]), mn(m["mae_n"]), interval(m["mae_ci95_n"]), mn(m["rmse_n"]), mn(m["max_n"]),
            mn(m["bias_n"]), fixed(m["r2"], 2), share(m["coverage"]), share(scores["abstained_share"]),
        ))  # fmt: skip
    width = max(len(cells[0]) for cells in table)
    lines = [_line(_HEAD, width), *(_line(cells, width) for cells in table)]
    sections = (_thesis_lines, _trust_lines, _comparison_lines, _bound_lines, _perturbed_lines)
    below = [line for section in sections for line in section(metrics)]
    return [" ".join(metrics["verdict"]), *metrics["notes"], "", *lines, "", *below]


_COMPARED = ("", "MAE mN", "RMSE", "max", "bias", "Fx MAE", "Fy MAE", "R2", "coverage %", "abstained %", "us a frame")


def _comparison_lines(metrics: dict[str, Any]) -> list[str]:
    """Writes thesis table 2, measured: a line a method, sensors in the tip, and where each method breaks."""
    compared = metrics["comparison"]
    if compared is None:
        return []
    mn, fixed, share = (FILTERS[name] for name in ("mn", "fixed", "share"))
    table: list[tuple[str, ...]] = []
    for row in compared["rows"]:
        errors = [mn(row[key]) for key in ("mae_n", "rmse_n", "max_n", "bias_n", "x_mae_n", "y_mae_n")]
        shares = [share(row[key]) for key in ("coverage", "abstained_share")]
        table.append((row["method"], *errors, fixed(row["r2"], 2), *shares, fixed(row["update_us"], 0)))
    table += [(f"{name}, sensor in the tip", mn(error)) for name, error in compared["sensors"].items()]
    width = max(len(cells[0]) for cells in table)
    breaks = [f"{row['method']}: {row['breaks']}" for row in compared["rows"] if row["breaks"]]
    lines = [_line(cells, width, _COMPARED) for cells in (_COMPARED, *table)]
    return ["Methods side by side:", *lines, f"Sensors: {compared['sensor_source']}.", "", *breaks, ""]


_BESIDE_THESIS = ("", "forces N", "MAE mN", "min", "max", "RMSE x, y mN", "max x, y")


def _thesis_lines(metrics: dict[str, Any]) -> list[str]:
    """Writes each of the thesis's methods under its protocol beside the thesis's own figures, and the differences."""
    mn, newtons, lines = FILTERS["mn"], FILTERS["newtons"], list[str]()
    for beside in metrics["beside_thesis"].values():
        table: list[tuple[str, ...]] = []
        for name, row in beside["rows"].items():
            directions = row["by_direction"]
            forces = "–" if "force_min_n" not in row else f"{newtons(row['force_min_n'])}-{newtons(row['force_max_n'])}"
            errors = (mn(row.get(key)) for key in ("mae_n", "min_error_n", "max_error_n"))
            by_axis = ([mn(each[key]) for each in directions.values()] for key in ("rmse_n", "max_error_n"))
            table.append((f"  {name}", forces, *errors, *(", ".join(values) or "–" for values in by_axis)))
        width = max(len(cells[0]) for cells in table)
        # the widest cell of each column sets its width
        heads = tuple(max((row[k] for row in (_BESIDE_THESIS, *table)), key=len) for k in range(len(_BESIDE_THESIS)))
        lines += [
            "Beside the thesis:",
            *(_line(cells, width, heads) for cells in (_BESIDE_THESIS, *table)),
            beside["text"],
            "",
        ]
    return lines


def _trust_lines(metrics: dict[str, Any]) -> list[str]:
    """Writes a line a method: wrong estimates, area under its retention curve, coverage by force, worst stratum."""
    truth = metrics["data"]["truth"]
    results = [each for each in metrics["results"] if each["protocol"] == metrics["strictest_protocol"]]
    trusts = {each["method"]: each["against_truth" if truth else "against_sensor"]["trust"] for each in results}
    first = next(iter(trusts.values()))
    strata = sorted({each["from_n"]: each["below_n"] for t in trusts.values() for each in t["by_force"]}.items())
    mn, share = FILTERS["mn"], FILTERS["share"]
    heads = tuple(f"{low:g}-{high:g} N" if high is not None else f">{low:g} N" for low, high in strata)
    table: list[tuple[str, ...]] = [("", "wrong %", "area mN", *heads, "worst %")]
    few = False
    for method, trust in trusts.items():
        stratum_from = {each["from_n"]: each for each in trust["by_force"]}
        cells: list[str] = []
        for low, _ in strata:
            part = stratum_from.get(low)
            few |= part is not None and part["few"]
            cells.append("–" if part is None else share(part["coverage"]) + "*" * part["few"])
        worst = f"{share(trust['worst_coverage'])} ({trust['worst_stratum']})" if trust["worst_stratum"] else "–"
        name = "constant predictor" if method == Constant.name else method
        area = mn(trust["retention"]["area_n"])
        table.append((f"  {name}", share(trust["wrong_share"]), area, *cells, worst))
    width = max(len(cells[0]) for cells in table)
    heads_of = tuple(max((row[column] for row in table), key=len) for column in range(len(table[0])))
    title = (
        f"Trust, against the {'truth' if truth else 'sensor'}: answers off by more than "
        f"{1e3 * first['wrong_beyond_n']:.0f} mN, error over abstention, coverage of the 90 % intervals in % by force"
    )
    return [
        f"{title}; * fewer than {first['few_samples']} samples:" if few else f"{title}:",
        *(_line(cells, width, heads_of) for cells in table),
        "",
    ]


def _bound_lines(metrics: dict[str, Any]) -> list[str]:
    """Writes in one line each method's error over its Cramer-Rao bound under the strictest protocol."""
    fixed, ratios = FILTERS["fixed"], list[str]()
    for result in metrics["results"]:
        bound = result["against_bound"]
        if bound is None or result["protocol"] != metrics["strictest_protocol"] or result["method"] == Constant.name:
            continue
        single, all_frames = (
            fixed(bound[kind]["magnitude"]["all"]["ratio"], 2) for kind in ("one_frame", "all_frames")
        )
        ratios.append(f"{result['method']} {single} (one frame), {all_frames} (all frames until then)")
    if not ratios:
        return []
    return [f"Error over the Cramer-Rao bound: {'; '.join(ratios)}. Its unknown quantities: metrics.json.", ""]


def _perturbed_lines(metrics: dict[str, Any]) -> list[str]:
    """Writes each method's error under the largest perturbation of each kind."""
    if metrics["perturbed"] is None:
        return []
    mn, share, text_lines = FILTERS["mn"], FILTERS["share"], list[str]()
    for method, (plain, *lines) in metrics["perturbed"].items():
        largest = {line["kind"]: line for line in lines}  # the last line of a kind has the largest size
        texts = [
            f"{kind} {line['size']} {mn(line['mae_n'])} ({share(line['abstained_share'])} % abstained)"
            for kind, line in largest.items()
            if "," not in kind
        ]
        text_lines.append(
            f"{method}, perturbed, MAE in mN on {plain['samples']} frames: {UNPERTURBED} "
            f"{mn(plain['mae_n'])}, {', '.join(texts)}; "
            f"a constant {mn(plain['constant']['mae_n'])}"
        )
    return [*text_lines, ""]


def _line(cells: tuple[str, ...], first_width: int, heads: tuple[str, ...] = _HEAD) -> str:
    """Returns a line of a table: the first cell ``first_width`` wide, each other one wider than its head."""
    rest = "".join(cell.rjust(max(9, len(head) + 2)) for cell, head in zip(cells[1:], heads[1:], strict=False))
    return (cells[0].ljust(first_width) + rest).rstrip()
