"""Samples a second, here and on a Ray cluster of this machine, and whether the bytes are the same.

    python -m bench.studies.cluster [--samples N] [--only WAY] [--json FILE]

The same set of labelled images (bench-2021, 640x480) is made in 1 and 2 processes, on one Ray node with 1 and 2
workers, on two nodes with one worker each, and on two nodes where a worker is killed once. Needs the extra [cluster].
Starting Ray and its workers is not in the times; starting the processes of the local pool is.
"""

import argparse
import hashlib
import json
import os
import signal
import tempfile
import time
from functools import partial
from pathlib import Path

from bench.machine import machine

from tipforce._system.executor import Executor, LocalExecutor
from tipforce._system.ray import RayExecutor
from tipforce.pipelines import simulate_dataset

PER_SESSION = 20
WAYS = {
    "1 process": (0, 0),
    "2 processes": (0, 0),
    "Ray, 1 node, 1 worker": (1, 1),
    "Ray, 1 node, 2 workers": (1, 2),
    "Ray, 2 nodes, 1 worker each": (2, 1),
    "Ray, 2 nodes, a worker killed": (2, 1),
}
"""Way -> nodes, cores of each."""


def checksum(folder: Path) -> str:
    """Returns the checksum of the names and contents of all files."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def kill_one(killed: list[int], folder: Path, *_: object) -> None:
    """Kills a worker of Ray during its drawing, once, after a session is complete."""
    if killed or not list(folder.glob(".parts/*.json")):
        return
    for path in Path("/proc").iterdir():
        if not path.name.isdigit():
            continue
        try:
            if (path / "cmdline").read_bytes().startswith(b"ray::_work") and _is_ours(int(path.name)):
                os.kill(int(path.name), signal.SIGKILL)
                killed.append(int(path.name))
                return
        except OSError:
            continue  # it ended meanwhile


def _is_ours(pid: int) -> bool:
    """Whether this process started it, directly or not."""
    while pid > 1:
        if pid == os.getpid():
            return True
        pid = int((Path("/proc") / str(pid) / "stat").read_text().rsplit(")", 1)[1].split()[1])
    return False


def seconds(executor: Executor, folder: Path, samples: int, kill: bool) -> tuple[float, bool]:
    """Time of a set without its first sessions, and whether a worker was killed."""
    killed: list[int] = []
    workers = 2
    make = partial(simulate_dataset, samples_per_session=PER_SESSION, seconds=8.0, seed=3, executor=executor)
    make(folder / "warm", samples=workers * PER_SESSION)
    begun = time.monotonic()
    make(folder / "set", samples=samples, progress=partial(kill_one, killed, folder / "set") if kill else None)
    return time.monotonic() - begun, bool(killed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=400)
    parser.add_argument("--only", choices=list(WAYS))
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    import ray
    from ray.cluster_utils import Cluster

    figures: dict[str, dict[str, object]] = {}
    for way, (nodes, cores) in WAYS.items():
        if chosen.only not in (None, way):
            continue
        cluster = None
        if nodes:
            cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": cores, "include_dashboard": False})
            for _ in range(nodes - 1):
                cluster.add_node(num_cpus=cores)
            ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
        executor = RayExecutor(cluster.address) if cluster else LocalExecutor(int(way[0]))
        with tempfile.TemporaryDirectory() as folder:
            took, killed = seconds(executor, Path(folder), chosen.samples, "killed" in way)
            figures[way] = {
                "samples_per_s": round(chosen.samples / took, 2),
                "seconds": round(took, 1),
                "checksum": checksum(Path(folder) / "set"),
                "killed": killed,
            }
        if cluster:
            ray.shutdown()
            cluster.shutdown()
        print(way, figures[way], flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps({"machine": machine(), **figures}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
