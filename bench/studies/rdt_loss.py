"""RDT of a Net F/T box at 1 kHz over loopback, with loss and reordering: every gap counted, none a false force?

    python -m bench.studies.rdt_loss [--minutes 10] [--loss 0.01] [--reorder 0.01] [--json FILE]

The box runs in a process of its own. Each packet carries its own number as force, so that a reading identifies its
packet. Every ten seconds another fault comes on top: 40 packets that the box leaves out, an error status with nonsense
in the counts for 50 ms, a sequence number that does not change for 50 ms, silence for 0.4 s.
"""

import argparse
import json
import multiprocessing
import os
import pathlib
import time

import numpy as np

from tipforce.hardware import HardwareSource, NetFt, NetFtConfig
from tipforce.hardware.emulators import NetFtEmulator, NetFtFaults

RATE_HZ, EVERY_S = 1000.0, 10.0
COUNTS = 1000.0


def box(pipe, loss, reorder):
    """Serves until a message on ``pipe`` ends it, then sends the counts of the packets."""
    emulator = NetFtEmulator(rate_hz=RATE_HZ, counts_per_force=COUNTS, faults=NetFtFaults(loss, reorder))
    emulator.force = lambda _: (emulator.rdt / COUNTS, 0.0, 0.0, 0.0, 0.0, 0.0)
    number = 0
    with emulator:
        pipe.send((emulator.port, emulator.http_port))
        faults, due = emulator.faults, time.monotonic() + EVERY_S
        while not pipe.poll(0.01):
            if time.monotonic() < due:
                continue
            due += EVERY_S
            if number % 4 == 0:
                faults.skip = 40
            elif number % 4 == 1:
                faults.status = 0x80020000
                time.sleep(0.05)
                faults.status = 0
            elif number % 4 == 2:
                faults.frozen = True
                time.sleep(0.05)
                faults.frozen = False
            else:
                faults.silent = True
                time.sleep(0.4)
                faults.silent = False
            number += 1
        if pipe.recv() == "clean":  # the last packets shall not be among the lost
            faults.loss = faults.reorder = 0.0
            time.sleep(0.3)
        last = emulator.rdt
    pipe.send((dict(emulator.sent), last))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--loss", type=float, default=0.01)
    parser.add_argument("--reorder", type=float, default=0.01)
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=box, args=(theirs, options.loss, options.reorder))
    process.start()
    port, http_port = ours.recv()
    driver = NetFt(NetFtConfig(host="127.0.0.1", port=port, http_port=http_port, rate_hz=RATE_HZ))
    numbers, stamps = [], []
    with HardwareSource([driver]) as source:
        assert source.wait_connected(10.0) == (), source.health()
        source.begin(60 * options.minutes)
        begun, processor = time.monotonic(), time.process_time()
        for event in source:
            numbers.append(event.force_n[0] * COUNTS)
            stamps.append(event.stamp_ns)
            if len(numbers) % 64 == 0 and time.monotonic() - begun > 60 * options.minutes - 1.0:
                ours.send("clean")
                break
        for event in source:
            numbers.append(event.force_n[0] * COUNTS)
            stamps.append(event.stamp_ns)
        took, processor = time.monotonic() - begun, time.process_time() - processor
        health = source.health()[0]
    sent, _ = ours.recv()
    process.join()
    found = np.array(numbers)
    whole = np.rint(found).astype(np.int64)
    steps = np.diff(whole)
    gaps = steps[steps > 1] - 1
    counts = {
        name: health.counts.get(name, 0) for name in ("lost", "late", "duplicate", "status", "frozen", "malformed")
    }
    # each packet between the first and the last reading is a reading, or was counted under one name
    missing = int(gaps.sum())
    counted = counts["lost"] + counts["late"] + counts["status"] + counts["frozen"]
    seconds = (np.array(stamps) - stamps[0]) * 1e-9
    late = 1e3 * (seconds - (whole - whole[0]) / RATE_HZ)
    figures = {
        "minutes": took / 60,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "processor_share": processor / took,
        "readings": len(found),
        "sent": sent,
        "counts": counts,
        "connections": health.connections,
        "dropped": health.streams[0].dropped,
        "gaps": len(gaps),
        "longest_gap_readings": int(gaps.max(initial=0)),
        "missing_readings": missing,
        "counted": counted,
        "false_forces": int((np.abs(found - whole) > 1e-6).sum() + (steps < 1).sum() + (whole > 1e8).sum()),
        "stamp_error_ms_p99": float(np.quantile(np.abs(late - np.median(late)), 0.99)),
    }
    print(json.dumps(figures, indent=2))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
