"""Ctrl-C and SIGTERM end a verb and all of its processes, say what is kept, and leave nothing half-written."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")


def of_session(leader: int) -> list[int]:
    """Processes of the session that ``leader`` began, without those that have ended."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, *rest = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if state not in "ZX" and int(rest[2]) == leader:
            found.append(int(stat.parent.name))
    return found


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_and_no_half_file_is_left_of_a_simulation(tmp_path: Path, number: signal.Signals) -> None:
    words = [
        "simulate",
        "--sessions",
        "2",
        "--seconds",
        "60",
        "--set",
        "width=160",
        "--set",
        "height=120",
        "-o",
        "runs",
    ]
    child = subprocess.Popen(
        [sys.executable, "-m", "tipforce", *words],
        cwd=tmp_path, env={**os.environ, "TIPFORCE_CORES": "2"},
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while len(of_session(child.pid)) < 4 and time.monotonic() < deadline:  # itself, two workers, multiprocessing's own
        time.sleep(0.05)
    (os.killpg if number is signal.SIGINT else os.kill)(child.pid, number)
    _, said = child.communicate(timeout=30)
    while of_session(child.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not of_session(child.pid)
    if number is not signal.SIGKILL:
        assert child.returncode == 128 + number
        stopped = f"tipforce: stopped by {number.name}; finished sessions are kept, and the same command goes on"
        assert stopped in said.splitlines()  # Python's resource tracker may have the last word
        assert "Traceback" not in said
        assert not list(tmp_path.rglob("*.part"))


def told_of(program: str) -> list[str]:
    """What a Python program writes that works on this package."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=30)
    assert not done.stderr
    return done.stdout.split()


ENDING = """
import os, signal, time
from tipforce._system.processes import Interrupted, signals_end_the_program, run_child, worker_pool
def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)
"""


def test_an_interrupt_in_a_finalizer_is_not_lost() -> None:
    program = """
class Finalized:
    def __del__(self):
        interrupt()
try:
    with signals_end_the_program():
        Finalized()
        time.sleep(20)
except Interrupted as stop:
    print(stop.signal.name)
"""
    assert told_of(ENDING + program) == ["SIGINT"]


def test_an_interrupt_that_became_another_error_stays_one() -> None:
    program = """
try:
    with signals_end_the_program():
        try:
            interrupt()
        except Interrupted as stop:
            raise ImportError("initialization failed") from stop
except Interrupted as stop:
    print(stop.signal.name)
try:
    with signals_end_the_program():
        raise ValueError
except ValueError:
    print("others stay")
"""
    assert told_of(ENDING + program) == ["SIGINT", "others", "stay"]


def test_a_child_program_never_gets_the_terminals_interrupt() -> None:
    program = """
import sys
with signals_end_the_program():
    done = run_child([sys.executable, "-c", "import os, signal; os.kill(os.getpid(), signal.SIGINT); print('on')"])
print(done.returncode)
"""
    assert told_of(ENDING + program) == ["on", "0"]


def test_a_worker_that_is_asked_to_end_cleans_up_and_begins_nothing_else(tmp_path: Path) -> None:
    program = f"""
from pathlib import Path
FOLDER = Path({str(tmp_path)!r})
def work(name):
    try:
        (FOLDER / name).touch()
        time.sleep(20)
    finally:
        (FOLDER / name).rename(FOLDER / "cleaned")
if __name__ == "__main__":
    try:
        with signals_end_the_program(), worker_pool(1) as pool:
            pool.submit(work, "first"), pool.submit(work, "second")
            while not (FOLDER / "first").exists():
                time.sleep(0.01)
            interrupt()
    except Interrupted:
        print("ended")
"""
    (tmp_path / "program.py").write_text(ENDING + program, encoding="utf-8")
    began = time.monotonic()
    done = subprocess.run([sys.executable, tmp_path / "program.py"], capture_output=True, text=True, timeout=30)
    assert (done.stdout.split(), done.stderr) == (["ended"], "")
    assert time.monotonic() - began < 20
    (tmp_path / "program.py").unlink()
    assert [path.name for path in tmp_path.iterdir()] == ["cleaned"]


def test_an_interrupt_while_the_program_is_loaded_is_one_sentence() -> None:
    program = """
import runpy, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "tipforce.cli":
            interrupt()
sys.meta_path.insert(0, Interrupting())
sys.stderr = sys.stdout
runpy.run_module("tipforce", run_name="__main__")
"""
    assert " ".join(told_of(ENDING + program)) == "tipforce: stopped by SIGINT"


def test_an_interrupt_within_the_import_of_a_compiled_module_waits_for_its_end() -> None:
    program = """
import importlib._bootstrap_external as external
from importlib.machinery import ExtensionFileLoader
from importlib.util import spec_from_loader
whole = []
def create(spec):
    interrupt()
    whole.append("whole")
external._imp = type("Imp", (), {"create_dynamic": staticmethod(create)})
try:
    with signals_end_the_program():
        loader = ExtensionFileLoader("module", "module.so")
        loader.create_module(spec_from_loader("module", loader))
        time.sleep(20)
except Interrupted as stop:
    print(*whole, stop.signal.name)
"""
    assert told_of(ENDING + program) == ["whole", "SIGINT"]


def test_an_interrupt_while_a_compiled_function_makes_its_named_tuple_waits_for_it() -> None:
    program = """
whole = []
# as collections.namedtuple makes its constructors
within = eval("lambda signal: [signal(), whole.append('whole')]", {"__name__": "namedtuple_Fit", "whole": whole})
try:
    with signals_end_the_program():
        within(interrupt)
        time.sleep(20)
except Interrupted as stop:
    print(*whole, stop.signal.name)
"""
    assert told_of(ENDING + program) == ["whole", "SIGINT"]
