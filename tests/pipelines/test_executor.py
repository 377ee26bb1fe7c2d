import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from tipforce._system import ray
from tipforce._system.executor import Executor, LocalExecutor, executor_of
from tipforce.errors import InputError, MissingExtraError
from tipforce.pipelines import _train
from tipforce.types import SessionInfo


def doubled(item: int, step: Callable[[], None]) -> int:
    step()
    step()
    if item == 13:
        raise InputError("13 is refused")
    return 2 * item


def test_results_come_in_the_order_of_the_items() -> None:
    shares: list[float] = []
    executor = LocalExecutor(workers=1)
    assert executor.run(doubled, [3, 1, 2], steps=2, progress=shares.append) == [6, 2, 4]
    assert shares == pytest.approx([k / 6 for k in range(1, 7)])
    assert executor.run(doubled, []) == []
    with pytest.raises(InputError, match="13 is refused"):
        executor.run(doubled, [1, 13])


def test_an_executor_is_chosen_by_name_or_given() -> None:
    assert executor_of("local") == LocalExecutor()
    mine = LocalExecutor(1)
    assert executor_of(mine) is mine
    assert isinstance(ray.RayExecutor(), Executor)


def test_without_ray_the_install_line_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtraError, match=r"ray is not installed; .*\[cluster\]"):
        executor_of("ray")


def setup_of(folder: Path, mark: Path | None = None, version: str = ray._version()) -> ray._Setup:
    return ray._Setup(doubled, str(folder), None if mark is None else str(mark), version)


def test_a_node_works_in_the_same_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # and back afterwards
    monkeypatch.setattr(ray, "limit_threads", lambda threads: None)
    shared = tmp_path / "shared"
    shared.mkdir()
    with ray._mark(shared) as mark:
        assert ray._work(setup_of(shared, mark), 0, 4) == 8
        assert Path.cwd() == shared
    assert not list(shared.iterdir())


def test_a_node_without_the_folder_is_refused(tmp_path: Path) -> None:
    for setup in (setup_of(tmp_path / "elsewhere"), setup_of(tmp_path, tmp_path / "mark of another folder")):
        with pytest.raises(InputError, match="on a file system that all nodes have at the same path"):
            ray._work(setup, 0, 4)


def test_a_node_with_another_version_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the others have 0\.0\.0; install the same"):
        ray._work(setup_of(tmp_path, version="0.0.0"), 0, 4)


def test_where_no_node_is_left_that_is_large_enough_the_largest_one_has_to_do() -> None:
    def left(*cpus_and_gpus: tuple[int, int]) -> dict[str, int] | None:
        nodes = [
            {"Alive": True, "Resources": {"CPU": cpus, "GPU": gpus} if gpus else {"CPU": cpus} if cpus else {}}
            for cpus, gpus in cpus_and_gpus
        ]
        gone = {"Alive": False, "Resources": {"CPU": 8, "GPU": 1}}
        return ray._left_for(SimpleNamespace(nodes=lambda: [gone, *nodes]), {"num_cpus": 8, "num_gpus": 1})

    assert left((2, 0), (8, 1)) is None
    assert left((2, 0), (4, 0), (16, 0)) == {"num_cpus": 16}
    assert left((2, 0), (4, 1)) == {"num_cpus": 4, "num_gpus": 1}
    assert left((0, 0)) is None  # nobody works there: Ray waits for nodes


@pytest.mark.parametrize("left", [False, True])
def test_a_training_goes_on_there_with_what_a_lost_node_left_and_may_have_saved(
    left: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[_train._Asked] = []
    monkeypatch.setattr(_train, "_train_here", lambda asked, progress: done.append(asked) or (None, {}, ()))
    asked = _train._Asked(
        "set", tmp_path / "model", "compact", None, SessionInfo(), None, (), None, None, 0.0, None, resume=False,
        overwrite=False, begun=False,
    )  # fmt: skip
    if left:
        (tmp_path / "model.training").mkdir()
        (tmp_path / "model.training" / "checkpoint.pt").touch()
    _train._train_there(asked, 0, lambda: None)
    assert [(each.resume, each.overwrite) for each in done] == [(left, left)]


_LIMITED = """
from tipforce._system.processes import limit_threads
limit_threads(1)
import threadpoolctl
assert {pool["num_threads"] for pool in threadpoolctl.threadpool_info()} == {1}, threadpoolctl.threadpool_info()
"""


def test_a_limit_of_threads_holds_for_all_libraries_of_a_process() -> None:
    subprocess.run([sys.executable, "-c", _LIMITED], check=True)
