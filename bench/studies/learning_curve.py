"""Measures a method's error by the number of its training samples: random 75/25 splits, one for each seed.

    python -m bench.studies.learning_curve DATA --estimator svr --set force=components --sizes 60 120 240 480 --seeds 5
        --json curve.json --figure curve.svg

Prints RMSE by component, mean and standard deviation over the seeds, for each number of training samples and for the
whole training part, beside the constant predictor's. A smaller number is a part of the larger ones of its seed; the
test part is the same for all. Each fit is kept in the JSON file as soon as it is done: a fit in that file is not
repeated, so that an interrupted study continues, and may get more sizes or seeds.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tipforce.cli._settings import settings_from
from tipforce.datasets import Dataset, open_dataset, random_split, random_subset
from tipforce.errors import TipforceError
from tipforce.estimators import Estimator, NetworkEstimator, create, load_initial_model, method
from tipforce.evaluation import Constant, error_metrics
from tipforce.evaluation.report._style import (
    GREY,
    METHOD_COLOURS,
    grams_axis,
    make_figure,
    standalone_svg,
    to_svg,
)
from tipforce.types import FloatArray

TEST_SHARE = 0.25
AXES = ("x", "y", "z")


def rmse_n(estimator: Estimator, test: Dataset) -> dict[str, Any]:
    """Returns RMSE in newtons of the estimates, by component and for the magnitude, and the share that abstained."""
    answers = estimator.predict(test)
    force: FloatArray = np.array([answer.force_n for answer in answers])
    size: FloatArray = np.array([answer.magnitude_n for answer in answers])
    found = {"magnitude": error_metrics(test.magnitude_n, size)["rmse_n"]}
    for axis in np.flatnonzero(test.known & np.isfinite(force).any(axis=0)).tolist():
        found[AXES[axis]] = error_metrics(test.force_n[:, axis], force[:, axis])["rmse_n"]
    plain = {name: value if np.isfinite(value) else None for name, value in found.items()}
    return {"rmse_n": plain, "refused_share": float(np.mean(~np.isfinite(size)))}


def study(
    make: Callable[[int], Estimator],
    dataset: Dataset,
    sizes: Iterable[int],
    seeds: int,
    path: Path,
    named: dict[str, Any],
    report: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Computes all fits that ``path`` does not have yet; returns its new contents.

    ``make``: the estimator of a seed. ``named``: properties that identify this study; a file of another study is
    refused. Sizes that the training part does not have are left out; the whole of it is always there.
    """
    about = {**named, "fingerprint": dataset.fingerprint(), "test_share": TEST_SHARE}
    held = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {"about": about, "fits": {}}
    if held["about"] != json.loads(json.dumps(about)):
        raise SystemExit(
            f"{path}: holds another study (method, settings or data differ); choose another name with --json"
        )
    for seed in range(seeds):
        split = random_split(dataset, TEST_SHARE, seed)
        order = np.random.default_rng(seed).permutation(split.train)
        test = dataset.subset(split.test)
        wanted = sorted({size for size in sizes if size < len(order)} | {len(order)})
        todo = [("constant", len(order)), *((str(size), size) for size in wanted)]
        for name, size in todo:
            key = f"{name} seed {seed}"
            if key in held["fits"]:
                continue
            started = time.perf_counter()
            fitted = (Constant() if name == "constant" else make(seed)).fit(dataset.subset(np.sort(order[:size])))
            cell = {"samples": size, "seed": seed, **rmse_n(fitted, test)}
            held["fits"][key] = {**cell, "seconds": round(time.perf_counter() - started, 2)}
            part = path.with_name(path.name + ".part")
            part.write_text(json.dumps(held, indent=1) + "\n", encoding="utf-8")
            part.replace(path)
            report(f"{key}: " + ", ".join(f"{k} {1e3 * v:.1f} mN" for k, v in cell["rmse_n"].items() if v is not None))
    return held


def curves(held: dict[str, Any]) -> dict[str, dict[int, FloatArray]]:
    """Component -> training samples -> RMSE (seeds,) in newtons; of the constant predictor under 0 samples."""
    found: dict[str, dict[int, list[float]]] = {}
    for key, fit in held["fits"].items():
        size = 0 if key.startswith("constant") else fit["samples"]
        for name, value in fit["rmse_n"].items():
            if value is not None:
                found.setdefault(name, {}).setdefault(size, []).append(value)
    return {name: {size: np.array(by[size]) for size in sorted(by)} for name, by in found.items()}


def table(held: dict[str, Any]) -> list[str]:
    """A line for each number of samples: mean and standard deviation over the seeds, in mN."""
    found = curves(held)
    lines = [
        "training samples  " + "".join(f"{name:>18}" for name in found) + "   RMSE, mN: mean +- deviation over seeds"
    ]
    for size in sorted({size for by in found.values() for size in by}):
        cells = [by.get(size, np.array([np.nan])) for by in found.values()]
        cells_text = "".join(
            f"{1e3 * c.mean():10.1f} +- {1e3 * (c.std(ddof=1) if len(c) > 1 else 0):4.1f}" for c in cells
        )
        lines.append(f"{size or 'constant':>16}  {cells_text}   {len(cells[0])} seeds")
    return lines


def figure(held: dict[str, Any]) -> Figure:
    """RMSE over the training samples, a panel for each component; dots: seeds."""
    found = curves(held)

    def fill(drawing: Figure) -> None:
        panels = drawing.subplots(1, len(found), squeeze=False, sharex=True)[0]
        for place, (axes, (name, by)) in enumerate(zip(panels, found.items(), strict=True)):
            sizes = [size for size in by if size]
            colour = METHOD_COLOURS[0]
            axes.plot(sizes, [by[size].mean() for size in sizes], "-", color=colour, label="mean of the seeds")
            for size in sizes:
                axes.plot(np.full(len(by[size]), size), by[size], "o", color=colour, markersize=3.5, alpha=0.5, mew=0)
            if 0 in by:
                axes.axhline(by[0].mean(), color=GREY, linestyle=(0, (4, 3)), label="constant predictor")
            axes.set_xscale("log")
            axes.set_xticks(sizes, [str(size) for size in sizes], rotation=45)
            axes.set_xticks([], minor=True)
            axes.set_ylim(bottom=0)
            axes.set_title(name if name == "magnitude" else f"$F_{name}$")
            axes.set_xlabel("training samples")
            if place == 0:
                axes.set_ylabel("RMSE of the test part, N")
        grams_axis(panels[-1])
        drawing.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left", ncols=2)

    title = f"{held['about']['estimator']}: error over the number of training samples"
    return make_figure(fill, title, 2.6 * len(found) + 1.6, 4.2)


def main() -> None:
    """Reads the command line, computes the missing fits, prints and draws."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--estimator", default="svr")
    parser.add_argument("--set", action="append", metavar="KEY=VALUE", help="a setting of the method; may be repeated")
    parser.add_argument("--sizes", type=int, nargs="*", default=[60, 120, 240, 480])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--from", dest="start", metavar="MODEL", help="networks: begin each fit with these weights")
    parser.add_argument("--samples", type=int, help="number of samples that are drawn first, with seed 0")
    parser.add_argument("--json", type=Path, default=Path("build/learning_curve.json"))
    parser.add_argument("--figure", type=Path, help="an SVG")
    options = parser.parse_args()
    options.json.parent.mkdir(parents=True, exist_ok=True)
    try:
        settings = settings_from(method(options.estimator).settings_type, options.set)
        dataset = open_dataset(options.data)
        if options.samples:
            dataset = random_subset(dataset, options.samples)
        start = load_initial_model(create(options.estimator, settings), options.start)
        if start is not None:
            settings = settings.for_fine_tuning()
        named = {"estimator": options.estimator, "settings": settings.model_dump(mode="json"), "data": dataset.title}
        named |= {} if options.start is None else {"start": options.start}

        def make(seed: int) -> Estimator:
            own = "seed" in type(settings).model_fields and "seed" not in settings.model_fields_set
            made = create(options.estimator, settings.model_copy(update={"seed": seed}) if own else settings)
            return made.fine_tuned_from(start) if isinstance(made, NetworkEstimator) and start else made

        held = study(make, dataset, options.sizes, options.seeds, options.json, named)
    except TipforceError as error:
        parser.error(str(error))
    print(*table(held), sep="\n")
    if options.figure:
        options.figure.write_text(standalone_svg(to_svg(figure(held))), encoding="utf-8")


if __name__ == "__main__":
    main()
