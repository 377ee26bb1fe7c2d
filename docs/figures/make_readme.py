"""Draws readme.png from the files of `make demo`: one frame with the force in it, and the force over ten seconds.

The session is the last one of the demo, which no model has seen; the errors in the legend are those of the
report, over both held-out sessions. From the root of the project: python docs/figures/make_readme.py demo/
"""

import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from tipforce.datasets import Dataset, open_dataset
from tipforce.estimators import load_model
from tipforce.types import BoolArray, ForceEstimate, Image
from tipforce.units import newtons_to_grams
from tipforce.vision import draw_estimate

INK, GREY, ORANGE = "#1c2733", "#8a949e", "#d55e00"
METHODS = (
    ("svr", "models/svr", "method 1 (svr)", "#b8860b", 1.0),
    ("pretrained/compact", "pretrained/compact", "compact as it comes", "#56b4e9", 1.2),
    ("compact", "models/compact", "compact fine-tuned", "#0072b2", 1.6),
)
"""Label in the report, model, words in the legend, colour, line width."""
SECONDS = 10.0


def errors(demo: Path) -> dict[str, tuple[float, float]]:
    """Label -> mean absolute error in N and share abstained, of the demo's report."""
    results = json.loads((demo / "report" / "metrics.json").read_text(encoding="utf-8"))["results"]
    scores = {result["method"]: result["against_sensor"] for result in results}
    return {name: (s["quantities"]["magnitude"]["mae_n"], s["abstained_share"]) for name, s in scores.items()}


def frame_with_force(test: Dataset, part: BoolArray, best: list[ForceEstimate], svr: list[ForceEstimate]) -> Image:
    """A frame near the peak of ``part``: the shape as method 1 detects it, the force as the best model estimates it."""
    shown = [i for i in np.flatnonzero(part).tolist() if best[i].valid and svr[i].shape is not None]
    shown.sort(key=lambda i: best[i].magnitude_n)
    index = shown[int(0.9 * len(shown))]
    image = next(test.subset(np.array([index])).observations()).views["camera"]
    assert isinstance(image, np.ndarray)
    return draw_estimate(image, svr[index].shape, best[index])


def main(demo: Path) -> None:
    """Draw and save beside this script."""
    data = open_dataset(demo / "runs")
    test = data.subset(data.session == data.sessions[-1])
    seconds = (test.stamp_ns - test.stamp_ns[0]) * 1e-9
    start = float(seconds[-1]) - SECONDS - 1.0
    part = (seconds > start) & (seconds < start + SECONDS)

    plt.rcParams.update({"font.size": 12, "text.color": INK, "axes.edgecolor": GREY, "axes.labelcolor": INK})
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.9), width_ratios=[1, 1.3], layout="constrained")
    left.set_axis_off()
    left.set_title("one frame of the simulated bench", loc="left")

    right.axhspan(0.0, 0.1, color=ORANGE, alpha=0.07, lw=0)
    right.axhspan(0.4, 0.5, color=ORANGE, alpha=0.07, lw=0)
    box = {"fc": "white", "ec": "none", "pad": 1.5, "alpha": 0.85}
    for level, text, side in ((0.1, "too little below 0.1 N", "top"), (0.4, "too much above 0.4 N", "bottom")):
        right.axhline(level, color=ORANGE, lw=0.8, ls="--")
        place = level + (-0.006 if side == "top" else 0.006)
        right.text(0.08, place, text, color=ORANGE, fontsize=9.5, va=side, bbox=box, zorder=9)
    found, estimates = errors(demo), dict[str, list[ForceEstimate]]()
    time = seconds[part] - start
    right.plot(time, test.magnitude_n[part], color=INK, lw=2.2, label="reference: sensor under the tissue")
    for label, model, words, colour, width in METHODS:
        if label not in found:
            continue
        folder = model if model.startswith("pretrained/") else demo / model
        estimates[label] = load_model(folder).predict(test)
        force = np.array([estimate.magnitude_n for estimate in estimates[label]])
        mae_n, abstained = found[label]
        silent = f", abstains on {abstained:.0%}" if abstained >= 0.005 else ""
        text = f"{words}: MAE {newtons_to_grams(mae_n):.1f} g ({1e3 * mae_n:.0f} mN){silent}"
        right.plot(time, force[part], color=colour, lw=width, label=text)
        print(text)
    best = min(estimates, key=lambda label: found[label][0])
    left.imshow(frame_with_force(test, part, estimates[best], estimates["svr"]))
    right.set(xlim=(0, SECONDS), ylim=(0, 0.5), xlabel="time, s", ylabel="force on the tip, N")
    grams = right.secondary_yaxis("right", functions=(newtons_to_grams, lambda g: g * 9.80665e-3))
    grams.set_ylabel("g")
    right.set_title("ten seconds of a session never seen", loc="left")
    figure.legend(loc="outside lower right", frameon=False, ncols=2, fontsize=10.5, handlelength=1.6)
    right.spines["top"].set_visible(False)
    figure.savefig(Path(__file__).with_name("readme.png"), dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
