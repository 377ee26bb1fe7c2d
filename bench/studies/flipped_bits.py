"""Recordings with one flipped bit at a random position: is each reported, and what does checking cost?

    python -m bench.studies.flipped_bits [RUN.mcap] [--times 200] [--seed 0] [--verbs 5] [--json FILE]

Without a recording, one of 20 s is simulated. Each copy has one flipped bit; all of it is then read with the library,
and `tipforce inspect` looks at the first --verbs of them. "reported": one sentence; "harmless": all that is read is the
same as before; "wrong": neither. Reading is timed as it is, and on the same file with every checksum set to zero,
which the format has for "not stated".
"""

import argparse
import json
import random
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from tipforce.errors import TipforceError
from tipforce.io import RecordingReader


def content(path: Path) -> list[bytes]:
    """Returns the contents of a recording: metadata, stamps and values of every stream, compressed images."""
    with RecordingReader(path) as reader:
        parts = [repr((reader.session_info, sorted(reader.info.metadata.items()))).encode()]
        for name, stream in reader.info.streams.items():
            parts += [f"{name} {stream.kind}".encode(), reader.stamps(name).tobytes()]
            if stream.kind == "wrench":
                parts += [values.tobytes() for values in reader.wrenches(name)]
            elif stream.kind == "actuation":
                parts += [repr(event).encode() for event in reader.events(name)]
            elif stream.kind == "frame":
                parts += [bytes(data) for data in reader.compressed(name)]
    return parts


def outcome(path: Path, whole: list[bytes]) -> str:
    """Returns the outcome for ``path``: reported, harmless or wrong, or the name of an unexpected error."""
    try:
        return "harmless" if content(path) == whole else "wrong"
    except TipforceError as error:
        return "reported" if "\n" not in str(error) else "reported in several lines"
    except Exception as error:
        return type(error).__name__


def by_inspect(path: Path) -> tuple[int, str]:
    """Exit code and last line of ``tipforce inspect``."""
    command = [sys.executable, "-m", "tipforce", "inspect", str(path), "-o", str(path.with_suffix(".png"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, (done.stderr.strip().splitlines() or [""])[-1]


def without_checksums(raw: bytes) -> bytearray:
    """The same recording with every checksum set to zero."""
    made = bytearray(raw)
    (start,) = struct.unpack_from("<Q", raw, len(raw) - 28)
    with tempfile.TemporaryFile() as file:
        file.write(raw)
        file.seek(0)
        summary = make_reader(file).get_summary()
    assert summary is not None
    for chunk in summary.chunk_indexes:
        made[chunk.chunk_start_offset + 33 : chunk.chunk_start_offset + 37] = bytes(4)
    made[start - 4 : start] = bytes(4)
    made[-12:-8] = bytes(4)
    return made


def seconds(path: Path, times: int = 5) -> tuple[float, float]:
    """Best times of opening a recording, and of reading all of it, without decoding the images."""
    opening, reading = [], []
    for _ in range(times):
        began = time.perf_counter()
        RecordingReader(path).close()
        opening.append(time.perf_counter() - began)
        content(path)
        reading.append(time.perf_counter() - began - opening[-1])
    return min(opening), min(reading)


def measure(path: Path, times: int, seed: int, verbs: int) -> dict[str, object]:
    """Flips bits of copies of ``path`` and reads them."""
    raw, chance = path.read_bytes(), random.Random(seed)
    whole = content(path)
    counts: Counter[str] = Counter()
    said: list[tuple[int, str]] = []
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name) / "flipped.mcap"
        copy.write_bytes(without_checksums(raw))
        unchecked = seconds(copy)
        copy.write_bytes(raw)
        checked = seconds(copy)
        for number in range(times):
            place, bit = chance.randrange(len(raw)), chance.randrange(8)
            with copy.open("r+b") as file:
                file.seek(place)
                file.write(bytes([raw[place] ^ 1 << bit]))
            counts[outcome(copy, whole)] += 1
            if number < verbs:
                said.append(by_inspect(copy))
            with copy.open("r+b") as file:
                file.seek(place)
                file.write(raw[place : place + 1])
    return {
        "bytes": len(raw),
        "flipped": dict(counts),
        "inspect_exit_codes": [code for code, _ in said],
        "inspect_says": [line for _, line in said],
        "open_s": checked[0],
        "open_without_checksums_s": unchecked[0],
        "read_s": checked[1],
        "read_without_checksums_s": unchecked[1],
    }


def main() -> None:
    """Reads the command line, and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, nargs="?")
    parser.add_argument("--times", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbs", type=int, default=5)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    np.seterr(all="raise")
    with tempfile.TemporaryDirectory() as name:
        path = options.recording
        if path is None:
            command = [sys.executable, "-m", "tipforce", "simulate", "--sessions", "1", "--seconds", "20", "-o", name]
            subprocess.run(command, check=True, capture_output=True)
            path = Path(name) / "session_00.mcap"
        figures = measure(path, options.times, options.seed, options.verbs)
    for key, value in figures.items():
        print(f"{key}: {value}")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
