"""Screenshots of the live page while a force is held on the simulated bench, in real time, through Chromium.

    python -m scripts.live_hold_screenshots [--model pretrained/compact] [--size 1600x900] [--output build/hold]
        [--figures docs/figures]

Bench, estimator, loop and page are those of `tipforce live --set hold.drives=both --set hold.contact=oblique`.
It needs a core for the bench and half of one for the browser; on a busier machine images come too late, and the loop
draws the catheter back, as it should.
"""

import argparse
import threading
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright
from scripts.live_screenshots import CHROMIUM, write_figures

from tipforce.estimators import load_model
from tipforce.pipelines import HoldSettings, LiveRunSettings, PageAddress, live, open_live_source

SETTINGS = LiveRunSettings(hold=HoldSettings(drives="both", contact="oblique"))
START_S, STATE_S = 240.0, 30.0
"""Kernels are compiled when they run for the first time; a state is reached within the latter."""
HELD_S = 8.0


class Over(Exception):
    """Ends the run."""


def main() -> None:
    """Reads the options, runs bench and page, and takes the screenshots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="pretrained/compact")
    parser.add_argument("--size", default="1600x900")
    parser.add_argument("--output", type=Path, default=Path("build/hold"))
    parser.add_argument("--figures", type=Path, help="also write that of the documentation, smaller, into this folder")
    chosen = parser.parse_args()
    chosen.output.mkdir(parents=True, exist_ok=True)
    width, height = (int(each) for each in chosen.size.split("x"))
    estimator, over = load_model(chosen.model), threading.Event()
    served: list[str] = []

    def until_over(_: object) -> None:
        if over.is_set():
            raise Over

    def run() -> None:
        with open_live_source(preset="bench-2021", settings=SETTINGS) as source:
            try:
                live(
                    estimator, source, model=chosen.model, page=PageAddress(), settings=SETTINGS,
                    on_page=served.append, on_update=until_over, on_report=lambda found: print(found.text()),
                )  # fmt: skip
            except Over:
                return

    running = threading.Thread(target=run)
    running.start()
    try:
        while not served:
            time.sleep(0.1)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": width, "height": height})
            page.goto(served[0])
            take(page, chosen.output, f"{width}x{height}")
            browser.close()
    finally:
        over.set()
        running.join()
    if chosen.figures is not None:
        write_figures(chosen.output, chosen.figures, {"live-hold": f"{chosen.size}-hold"})


def take(page: Page, output: Path, size: str) -> None:
    """A run from its start to its retraction."""

    def shot(name: str) -> None:
        page.screenshot(path=output / f"{size}-{name}.png")
        told = [page.inner_text(f"#loop-{part}") for part in ("word", "reason", "force", "wanted", "at")]
        print(name, *told, sep=" | ", flush=True)

    def reach(*states: str) -> None:
        page.wait_for_selector(",".join(f"#loop[data-state={state}]" for state in states), timeout=1e3 * STATE_S)

    page.wait_for_selector("body:is([data-kind=no_contact], [data-kind=in_window])", timeout=1e3 * START_S)
    time.sleep(2.0)
    shot("idle")
    while page.get_attribute("#loop", "data-state") == "idle":  # refused while no force is valid
        page.evaluate("for (const _ of [1, 2]) document.querySelector('#loop-begin').click()")
        time.sleep(0.5)
    for state in ("approach", "contact"):
        reach(state, "contact")
        shot(state)
    reach("hold")
    time.sleep(HELD_S)
    shot("hold")
    page.keyboard.press("Escape")
    reach("stopped")
    shot("stopped")
    page.click("#loop-release")
    reach("idle")
    page.click("#loop-retract")
    time.sleep(0.1)
    shot("retract")


if __name__ == "__main__":
    main()
