"""A Ray cluster of two nodes on this machine: the same bytes as locally, and nothing is lost with a process or node."""

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import threadpoolctl

from tipforce._system.executor import Executor, LocalExecutor
from tipforce._system.ray import RayExecutor
from tipforce.errors import InputError
from tipforce.estimators import training_started
from tipforce.pipelines import preset_settings, simulate_dataset, train
from tipforce.training import graph_weights

ray = pytest.importorskip("ray", reason="no ray: pip install -e '.[cluster]'")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")]


@pytest.fixture(scope="module", autouse=True)
def functions_travel() -> None:
    """The functions of this module as they are: no node can import a test."""
    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])


@pytest.fixture
def cluster() -> Iterator[Any]:
    from ray.cluster_utils import Cluster

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    yield made
    ray.shutdown()
    made.shutdown()


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def make(folder: Path, executor: Executor, progress: Callable[[str, float], None] | None = None) -> None:
    settings = preset_settings("bench-2021", None, {"width": 320, "height": 240, "world": {"tare_s": 2.0}})
    simulate_dataset(
        folder, settings, samples=40, samples_per_session=10, seconds=8, seed=3, executor=executor, progress=progress
    )


def test_a_set_has_the_same_bytes_on_two_nodes_one_of_which_dies(cluster: Any, tmp_path: Path) -> None:
    second = cluster.add_node(num_cpus=1)
    make(tmp_path / "local", LocalExecutor(workers=1))
    finished: dict[Path, int] = {}

    def progress(what: str, share: float) -> None:
        parts = list((tmp_path / "ray" / ".parts").glob("*.json"))
        if parts and not finished:  # a session is whole, others are on their way: take a node away
            finished.update({path: path.stat().st_mtime_ns for path in parts})
            cluster.remove_node(second, allow_graceful=False)
        elif share < 1.0:
            assert all(path.stat().st_mtime_ns == at for path, at in finished.items())

    make(tmp_path / "ray", RayExecutor(cluster.address), progress)
    assert 0 < len(finished) < 4
    assert files(tmp_path / "ray") == files(tmp_path / "local")
    assert not ray.is_initialized()


def test_a_training_there_gives_the_model_of_one_here(cluster: Any, tmp_path: Path) -> None:
    make(tmp_path / "set", LocalExecutor(workers=1))
    shares: list[float] = []
    here = train(tmp_path / "set", tmp_path / "here")
    there = train(
        tmp_path / "set", tmp_path / "there", executor=RayExecutor(cluster.address),
        progress=lambda what, share: shares.append(share),
    )  # fmt: skip
    assert (tmp_path / "there" / "arrays.npz").read_bytes() == (tmp_path / "here" / "arrays.npz").read_bytes()
    assert there.metrics == here.metrics
    assert there.lines == here.lines
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


QUICK = {"epochs": 8, "size": 96, "batch": 8, "rate": 0.001, "average": 0.0, "validation": 0.25, "precision": "fp32"}
"""Half a second an epoch, each of which is better than the one before."""
TIMES = {"seconds", "images_per_s", "waiting_share"}


def epochs_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "training.jsonl").read_text().splitlines()]


def without_times(model: Path) -> list[Any]:
    """The epochs and the manifest of a model; the checksums of the card and of itself tell times, too."""
    manifest = json.loads((model / "model.json").read_text())
    for name in ("README.md", "model.json", "training.jsonl"):
        del manifest["sha256"][name]
    for facts in (manifest["facts"], manifest["state"]["facts"]):
        del facts["seconds"]
    return [manifest, [{name: row[name] for name in row.keys() - TIMES} for row in epochs_of(model)]]


def kill_the_worker() -> None:
    psutil = pytest.importorskip("psutil", reason="Ray comes with psutil")
    children = psutil.Process().children(recursive=True)
    (worker,) = [each for each in children if each.name().startswith("ray::_work")]
    worker.kill()


def train_killed(folder: Path, name: str, address: str, kill: Callable[[], None]) -> list[dict[str, Any]]:
    """Trains a `compact` on the cluster; the epochs that its log had at the kill, after the first checkpoint."""
    work, before, killed_s, lost_s = folder / f"{name}.training", list[dict[str, Any]](), 0.0, 0.0

    def progress(what: str, share: float) -> None:
        nonlocal killed_s, lost_s
        if not before and training_started(folder / name):
            before.extend(epochs_of(work))
            kill()
            killed_s = time.monotonic()
        elif before and not lost_s and work.exists() and len(epochs_of(work)) > len(before):
            lost_s = time.monotonic() - killed_s

    executor = RayExecutor(address)
    train(folder / "set", folder / name, estimator="compact", settings=QUICK, executor=executor, progress=progress)
    print(f"{name}: killed after {len(before)} of {QUICK['epochs']} epochs, {lost_s:.1f} s until the next was done")
    return before


def test_a_network_goes_on_from_its_checkpoint_where_its_worker_or_node_dies(cluster: Any, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="training needs the extra [train]")
    larger = cluster.add_node(num_cpus=2)  # it is trained there
    make(tmp_path / "set", LocalExecutor(workers=1))
    with threadpoolctl.threadpool_limits(2):  # as there: the last digits of sums depend on it
        train(tmp_path / "set", tmp_path / "whole", estimator="compact", settings=QUICK)
    kills = {
        "worker": kill_the_worker,
        "node": lambda: cluster.remove_node(larger, allow_graceful=False),  # one with one core is left
    }
    for name, kill in kills.items():
        before = train_killed(tmp_path, name, cluster.address, kill)
        after = epochs_of(tmp_path / name)
        assert 1 <= len(before) < QUICK["epochs"]
        assert after[: len(before)] == before  # also their times: they were not trained again
        assert [row["epoch"] for row in after] == list(range(1, 1 + QUICK["epochs"]))
        kept = json.loads((tmp_path / name / "model.json").read_text())["facts"]["best_epoch"]
        assert kept > len(before)  # its weights are of an epoch after the kill
        assert not (tmp_path / f"{name}.training").exists()
    whole, same, close = (tmp_path / name for name in ("whole", "worker", "node"))
    for file in ("model.onnx", "arrays.npz"):
        assert (same / file).read_bytes() == (whole / file).read_bytes()
    assert without_times(same) == without_times(whole)
    weights, others = (graph_weights((each / "model.onnx").read_bytes()) for each in (close, whole))
    errors, wanted = ([row["validation_error_n"] for row in epochs_of(each)] for each in (close, whole))
    most = max(np.abs(values - others[name]).max() / np.abs(others[name]).max() for name, values in weights.items())
    print(
        f"on one core in place of two: weights differ by {most:.1e} of the largest, errors by"
        f" {1e3 * np.abs(np.subtract(errors, wanted)).max():.1e} mN"
    )
    np.testing.assert_allclose(errors, wanted, rtol=0.05)


def killed_once(folder: Path, item: int, step: Callable[[], None]) -> int:
    with (folder / f"{item}.txt").open("a") as seen:
        seen.write(f"{os.getpid()}\n")
    if item == 1 and (folder / "1.txt").read_text().count("\n") == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return item * item


def test_what_was_lost_with_a_killed_worker_is_done_again(cluster: Any, tmp_path: Path) -> None:
    shares: list[float] = []
    found = RayExecutor(cluster.address).run(
        partial(killed_once, tmp_path), range(4), shared=tmp_path, progress=shares.append
    )
    assert found == [0, 1, 4, 9]
    assert shares[-1] == 1.0
    assert [(tmp_path / f"{item}.txt").read_text().count("\n") for item in range(4)] == [1, 2, 1, 1]


def refused(item: int, step: Callable[[], None]) -> int:
    if item == 1:
        raise InputError("1 is refused")
    time.sleep(30.0 * (item > 1))
    return item


def test_what_a_task_raises_arrives_and_the_others_are_given_up(cluster: Any) -> None:
    begun = time.monotonic()
    with pytest.raises(InputError, match="1 is refused"):
        RayExecutor(cluster.address).run(refused, range(4))
    assert time.monotonic() - begun < 25.0
