"""Interrupts of every verb at random moments: processes that are left, seconds until the end, files that are left.

    python -m bench.studies.interrupts [--rounds 20] [--verbs simulate demo] [--after 1 15] [--seed 0] [--json FILE]

Each round starts a verb anew and sends SIGINT to its whole session, as a terminal does, or SIGTERM to it alone, or
SIGKILL to it alone (nothing can be said then, but no process may be left), 1 to 15 s after the start; `--after 0.1 3`
meets processes that are still starting. Linux only.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMMANDS = {
    "simulate": "simulate --sessions 4 --seconds 60 -o out",
    "demo": "demo -o out",
    "import": "import b/session_00/video.mp4 b/session_00/force.csv b/session_00/stage.csv"
    " --bench b/session_00/bench.toml -o out/run.mcap",
    "inspect": "inspect b/session_00/video.mp4 -o out/sheet.png",
    "train": "train runs --estimator compact --from pretrained --samples 200 -o out/model",
    "evaluate": "evaluate svr --data runs -o out/report",
    "estimate": "estimate pretrained/compact runs/session_00.mcap -o out/forces.csv --overlay out/overlay.mp4",
}


def of_session(leader: int) -> list[int]:
    """Returns the running processes of the session that ``leader`` began."""
    found: list[int] = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, *rest = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if state not in "ZX" and int(rest[2]) == leader:
                found.append(int(entry.name))
    return found


def one_round(verb: str, number: signal.Signals, after_s: float, place: Path) -> dict[str, object]:
    """Starts ``verb``, interrupts it, and checks the files that are left."""
    shutil.rmtree(place / "out", ignore_errors=True)
    for folder in place.glob("out*"):
        shutil.rmtree(folder)
    with subprocess.Popen(
        [sys.executable, "-m", "tipforce", *COMMANDS[verb].split()],
        cwd=place, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, start_new_session=True,
    ) as child:  # fmt: skip
        try:
            child.wait(after_s)
        except subprocess.TimeoutExpired:
            began = time.monotonic()
            (os.killpg if number is signal.SIGINT else os.kill)(child.pid, number)
            said = ""
            try:
                _, said = child.communicate(timeout=30)
            except subprocess.TimeoutExpired:
                child.kill()
            seconds = time.monotonic() - began
        else:
            return {"verb": verb, "signal": number.name, "ended_before": True}
    time.sleep(1.5 if number is signal.SIGKILL else 0.2)
    left = of_session(child.pid)
    for process in left:
        os.kill(process, signal.SIGKILL)
    return {
        "verb": verb,
        "signal": number.name,
        "after_s": round(after_s, 1),
        "exit_code": child.returncode,
        "seconds": round(seconds, 2),
        "orphans": len(left),
        "temporary_files": sum(1 for path in place.rglob("*.part")),
        "traceback": "Traceback" in said and number is not signal.SIGKILL,
        "said": said.strip().splitlines()[-1:] if "Traceback" not in said else said,
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.studies.interrupts", description=__doc__)
    parser.add_argument("--rounds", type=int, default=20, help="of each verb")
    parser.add_argument("--verbs", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--after", nargs=2, type=float, default=(1, 15), help="seconds from the start, from and to")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, default=Path("build/interrupts.json"))
    chosen = parser.parse_args()
    draw, rows = random.Random(chosen.seed), []
    with tempfile.TemporaryDirectory(prefix="tipforce-interrupts-") as folder:
        place = Path(folder)
        if set(chosen.verbs) - {"simulate", "demo"}:
            for words in (
                "simulate --as files --sessions 1 --seconds 15 -o b",
                "simulate --sessions 4 --seconds 15 -o runs",
            ):
                subprocess.run([sys.executable, "-m", "tipforce", *words.split()], cwd=place, check=True)
        for verb in chosen.verbs:
            for _ in range(chosen.rounds):
                number = draw.choice([signal.SIGINT, signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
                row = one_round(verb, number, draw.uniform(*chosen.after), place)
                rows.append(row)
                print(*(f"{key} {value}" for key, value in row.items()), sep=", ", flush=True)
    stopped = [row for row in rows if not row.get("ended_before")]
    asked = [row for row in stopped if row["signal"] != "SIGKILL"]
    print(
        f"{len(stopped)} interrupts: {sum(row['orphans'] for row in stopped)} orphans, slowest end "
        f"{max(row['seconds'] for row in asked):.2f} s, {sum(row['traceback'] for row in asked)} tracebacks, "
        f"{sum(row['temporary_files'] for row in asked)} temporary files"
    )
    chosen.json.parent.mkdir(parents=True, exist_ok=True)
    chosen.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
