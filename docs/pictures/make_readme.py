"""Draws readme.png from what `make demo` left: one frame with the force in it, and the force over ten seconds.

Of all sessions, each held out in turn, the one with the median error is shown: neither the best nor the worst.
Run from the project's root: python docs/pictures/make_readme.py demo/
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from tipforce.datasets import Dataset, open_dataset, random_subset, without_sessions
from tipforce.estimators import Svr, load_model
from tipforce.types import ForceEstimate, Image
from tipforce.units import newtons_to_grams
from tipforce.vision import draw_estimate

SAMPLES = 165
INK, BLUE, GREY, ORANGE = "#1c2733", "#0072b2", "#8a949e", "#d55e00"


def held_out(recipe: Svr, data: Dataset, session: str) -> tuple[Svr, Dataset, list[ForceEstimate], float]:
    """Estimates of ``session`` by a model that never saw it, and their MAE in N."""
    model = recipe.unfitted().fit(random_subset(without_sessions(data, [session]), SAMPLES))
    test = data.subset(data.session == session)
    estimates = model.predict(test)
    return (
        model,
        test,
        estimates,
        float(np.nanmean([abs(e.magnitude_n - t) for e, t in zip(estimates, test.magnitude_n, strict=True)])),
    )


def main(demo: Path) -> None:
    """Draw and save beside this script."""
    recipe = load_model(demo / "models" / "svr")
    assert isinstance(recipe, Svr)
    data = open_dataset(demo / "runs")
    runs = sorted((held_out(recipe, data, session) for session in data.sessions), key=lambda run: run[3])
    model, test, estimates, mae = runs[len(runs) // 2]
    print("MAE, mN:", {str(run[1].session[0]): round(1e3 * run[3], 1) for run in runs})

    seconds = (test.stamp_ns - test.stamp_ns[0]) * 1e-9
    start = float(seconds[-1]) - 11.0
    part = np.flatnonzero((seconds > start) & (seconds < start + 10.0))
    peak = int(part[np.argsort([estimates[i].magnitude_n for i in part])[int(0.9 * len(part))]])
    observation = next(test.subset(np.array([peak])).observations())
    image = observation.views["camera"]
    assert isinstance(image, np.ndarray)
    sighting, _ = model.look(observation, test.session_info[str(test.session[peak])])
    picture: Image = draw_estimate(image, sighting, estimates[peak])

    plt.rcParams.update({"font.size": 12, "text.color": INK, "axes.edgecolor": GREY, "axes.labelcolor": INK})
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.6), width_ratios=[1, 1.25], layout="constrained")
    left.imshow(picture)
    left.set_axis_off()
    left.set_title("one video frame of the simulated bench", loc="left")
    time = seconds[part] - start
    values = np.array([estimates[i].magnitude_n for i in part])
    band = np.array([estimates[i].magnitude_interval_n for i in part])
    right.fill_between(time, band[:, 0], band[:, 1], color=BLUE, alpha=0.15, lw=0, label="90 % interval")
    right.plot(time, test.magnitude_n[part], color=INK, lw=1.6, label="force sensor under the tissue")
    right.plot(time, values, color=BLUE, lw=1.6, label="tipforce, from the pictures alone")
    for level, text in ((0.1, "too little below"), (0.4, "too much above")):
        right.axhline(level, color=ORANGE, lw=1, ls="--")
        right.text(
            10.0,
            level,
            text,
            color=ORANGE,
            ha="right",
            va="bottom",
            fontsize=10,
            bbox={"fc": "white", "ec": "none", "pad": 1},
        )
    right.set(xlim=(0, 10), ylim=(0, 0.48), xlabel="time, s", ylabel="force on the tip, N")
    grams = right.secondary_yaxis("right", functions=(newtons_to_grams, lambda g: g * 9.80665e-3))
    grams.set_ylabel("g")
    right.set_title(
        f"a session never seen, the median one of {len(runs)}: MAE {newtons_to_grams(mae):.1f} g ({1e3 * mae:.0f} mN)",
        loc="left",
    )
    right.legend(
        loc="upper center",
        frameon=False,
        ncols=3,
        fontsize=9.5,
        columnspacing=1.0,
        handlelength=1.5,
        bbox_to_anchor=(0.5, 1.0),
    )
    right.spines["top"].set_visible(False)
    figure.savefig(Path(__file__).with_name("readme.png"), dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
