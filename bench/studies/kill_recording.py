"""kill -9 while a recording is written and while an import runs, at random moments: what is readable afterwards?

python -m bench.studies.kill_recording [--times 20] [--seed 0]
"""

import argparse
import mmap
import os
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

from tipforce.errors import FileFormatError
from tipforce.io import RecordingReader, RecordingWriter, write_force_csv, write_video
from tipforce.pipelines import import_session
from tipforce.types import Actuation, Frame, SessionInfo, SystemClock, Wrench

_LEDGER = struct.Struct("<qqqq")  # frames, wrenches and newest stamps that the writer has accepted


def _image(k: int, rng: np.random.Generator) -> np.ndarray:
    image = np.full((480, 640), 210, np.uint8)
    image[200 + k % 40 : 212 + k % 40, :420] = 40
    return image + rng.integers(0, 12, image.shape, dtype=np.uint8)


def record(folder: Path) -> None:
    """Writes 24 frames and 1000 readings a second, in real time, until killed; a ledger lists the written items."""
    clock, rng = SystemClock(), np.random.default_rng(0)
    images = [_image(k, rng) for k in range(48)]
    zero = clock.now_ns()
    with (folder / "ledger").open("r+b") as file, RecordingWriter(folder / "run.mcap", SessionInfo("run")) as writer:
        ledger = mmap.mmap(file.fileno(), _LEDGER.size)
        writer.write(Actuation(0, {"knob_deg": 10.0}))
        frames = 0
        for k in range(10_000_000):
            clock.sleep_until_ns(zero + k * 1_000_000)
            writer.write(Wrench(k * 1_000_000, np.array([0.1, 0.2, 0.0]), np.zeros(3), "sensor"))
            if k * 24 >= frames * 1000:
                writer.write(Frame(k * 1_000_000, images[frames % 48]))
                frames += 1
            ledger[:] = _LEDGER.pack(frames, k + 1, k * 1_000_000, 0)


def _kill_after(command: list[str], seconds: float) -> bool:
    """True where the process was still running when it was killed."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        return True
    return False


def _open(path: Path) -> tuple[int, int, int]:
    """Returns frames, readings and newest stamp of the readable part; every image is decoded."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = RecordingReader(path)
    with reader:
        events = list(reader)
    frames = sum(isinstance(event, Frame) for event in events)
    wrenches = sum(isinstance(event, Wrench) for event in events)
    return frames, wrenches, max(event.stamp_ns for event in events)


def kill_recordings(times: int, chance: random.Random) -> None:
    """Prints a table of the contents of each killed recording."""
    print("killed while recording (24 frames/s, 1 kHz force, real time)")
    print(f"{'':>3} {'killed at':>9} {'frames':>13} {'readings':>15} {'lost':>8}")
    worst = 0.0
    for number in range(times):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "ledger").write_bytes(bytes(_LEDGER.size))
            seconds = chance.uniform(1.5, 5.0)
            _kill_after([sys.executable, __file__, "--record", name], seconds)
            frames, wrenches, newest, _ = _LEDGER.unpack((folder / "ledger").read_bytes())
            assert not (folder / "run.mcap").exists(), "a killed recording must not look finished"
            try:
                got = _open(folder / "run.mcap")
            except FileFormatError as error:
                print(f"{number + 1:>3} {newest * 1e-9:8.2f} s  {error}")
                continue
            assert (folder / "run.mcap").exists()
            assert not (folder / "run.mcap.part").exists()
            lost = max((newest - got[2]) * 1e-9, 0.0)
            worst = max(worst, lost)
            print(
                f"{number + 1:>3} {newest * 1e-9:8.2f} s {got[0]:>6}/{frames:<6} {got[1]:>7}/{wrenches:<7} "
                f"{lost:6.3f} s"
            )
    print(f"worst loss: {worst:.3f} s\n")


def kill_imports(times: int, chance: random.Random) -> None:
    """Prints the files after each killed import, and whether the same import then works."""
    with tempfile.TemporaryDirectory() as name:
        folder, rng = Path(name), np.random.default_rng(1)
        write_video(folder / "video.mp4", (Frame(k * 41_666_667, _image(k, rng)) for k in range(480)), 24)
        stamps = np.arange(20_000) * 1_000_000
        force = np.stack([0.1 * np.sin(stamps * 1e-9 * 7), 0 * stamps, 0 * stamps], axis=1)
        write_force_csv(folder / "force.csv", stamps, force)
        target = folder / "run.mcap"
        command = [sys.executable, "-c", "from tipforce.cli import main; main()"]
        command += ["import", str(folder / "video.mp4"), str(folder / "force.csv")]
        command += ["--knob-deg", "10", "--offset-ms", "none", "-o", str(target)]
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        whole = time.perf_counter() - start
        target.unlink()
        print(f"killed while importing (20 s of video and force; whole import: {whole:.1f} s)")
        print(f"{'':>3} {'killed at':>9}  {'run.mcap':<10} {'left over':<14} {'run.mcap opens':<16} same import again")
        for number in range(times):
            seconds = chance.uniform(0.3, 1.0) * whole
            if not _kill_after(command, seconds):
                print(f"{number + 1:>3} {seconds:8.2f} s  was done before")
                target.unlink()
                continue
            finished, part = target.exists(), Path(f"{target}.part").exists()
            try:
                opens = f"{_open(target)[0]} frames"
            except FileFormatError as error:
                opens = "refused" if "import" in str(error) or "no such file" in str(error) else f"refused: {error}"
            import_session(folder / "video.mp4", folder / "force.csv", target, offset_ms="none", overwrite=finished)
            again = _open(target)
            print(
                f"{number + 1:>3} {seconds:8.2f} s  {'finished' if finished else 'absent':<10} "
                f"{'.part' if part else 'nothing':<14} {opens:<16} {again[0]}/480 frames, {again[1]}/20000 readings"
            )
            target.unlink()


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.record:
        record(options.record)
        return
    chance = random.Random(options.seed)
    kill_recordings(options.times, chance)
    kill_imports(options.times, chance)


if __name__ == "__main__":
    main()
