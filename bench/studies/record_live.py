"""`record` on a bench in real time: a 60 Hz camera (640x480) and 1 kHz of force. Is anything lost?

    python -m bench.studies.record_live [--minutes 10] [--fps 60] [--json FILE]

Camera (motion JPEG by HTTP) and force sensor (RDT) are emulators in a process of their own; the data that they sent
are compared with the recording. The clock offset is not searched: it is found after the recording.
"""

import argparse
import json
import multiprocessing
import os
import pathlib
import resource
import tempfile
import time

import numpy as np

from tipforce.hardware.emulators import CameraEmulator, NetFtEmulator
from tipforce.io import RecordingReader
from tipforce.pipelines import BenchRecording

_BENCH = """
[sensor]
angle_deg = 0.0
reads = "tip-on-tissue"
[hardware.cameras.camera]
driver = "opencv"
device = "{url}"
grey = true
[hardware.force]
driver = "net-ft"
host = "127.0.0.1"
port = {port}
http_port = {http}
rate_hz = 1000.0
"""


def devices(pipe, fps):
    rng = np.random.default_rng(0)
    images = [np.full((480, 640), 210, np.uint8) - rng.integers(0, 12, (480, 640), dtype=np.uint8) for _ in range(8)]
    for number, image in enumerate(images):
        image[200 + number : 212 + number, :420] = 40
    with CameraEmulator(lambda k: images[k % 8], fps=fps) as camera, NetFtEmulator() as box:
        pipe.send((camera.url, box.port, box.http_port))
        pipe.recv()
        pipe.send((camera.sent, dict(box.sent)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--fps", type=float, default=60.0)
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=devices, args=(theirs, options.fps))
    process.start()
    url, port, http = ours.recv()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "bench.toml").write_text(_BENCH.format(url=url, port=port, http=http))
        recording = BenchRecording(folder / "bench.toml", seconds=60 * options.minutes)
        recording.connect()
        begun, processor = time.monotonic(), time.process_time()
        recording.run(folder / "run.mcap", tare="none", offset_ms="none")
        took, processor = time.monotonic() - begun, time.process_time() - processor
        ours.send("end")
        camera_sent, box_sent = ours.recv()
        process.join()
        with RecordingReader(folder / "run.mcap") as reader:
            streams = reader.info.streams
            steps = 1e-6 * np.diff(reader.stamps())
        size = (folder / "run.mcap").stat().st_size / 1e6
    health = {device.name: device for device in recording.health_at_end}
    figures = {
        "minutes": took / 60,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "processor_share": processor / took,
        "frames": streams["camera"].count,
        "frames_per_s": streams["camera"].count / took,
        "camera_sent_all_in_all": camera_sent,
        "frame_step_ms_p50_p99_max": [float(np.quantile(steps, q)) for q in (0.5, 0.99, 1.0)],
        "frames_dropped": health["cameras.camera"].streams[0].dropped,
        "readings": streams["force"].count,
        "readings_dropped": health["force"].streams[0].dropped,
        "readings_lost": health["force"].counts.get("lost", 0),
        "box_made_all_in_all": box_sent["made"],
        "megabytes": size,
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    print(json.dumps(figures, indent=2))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
