"""A short run of the suite, with the same cases every time; `make prove` runs more.

``python -m tests.fuzz`` runs as many as asked.
"""

import sys
import time
from pathlib import Path

import pytest

from .corpus import make_corpus  # type: ignore[import-not-found]
from .run import Worker, fuzz, table  # type: ignore[import-not-found]
from .spoil import Spoiler  # type: ignore[import-not-found]
from .targets import TARGETS, Case  # type: ignore[import-not-found]
from .worker import run_words  # type: ignore[import-not-found]

CASES, SECONDS = 2, 12.0
"""Of each target, and after how long no further one is begun: on a busy machine there are fewer."""


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz") / "corpus"
    make_corpus(folder)
    return folder


def test_spoiled_inputs_are_answered_or_refused_in_one_line(corpus: Path) -> None:
    runs = fuzz(corpus, list(TARGETS), 0, lambda _: range(CASES), until=time.monotonic() + SECONDS)
    failures = [f"{each.again}\n    {each.outcome}: {each.last}" for run in runs for each in run.failures]
    assert not failures, "\n".join([table(runs), *failures])


def test_the_same_seed_spoils_alike(corpus: Path, tmp_path: Path) -> None:
    for target, makes in TARGETS.items():
        made = []
        for place in ("a", "b"):
            folder = tmp_path / place / target
            folder.mkdir(parents=True)
            words = makes[0](Spoiler("one"), corpus, folder).words
            files = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
            made.append(([word.replace(str(folder), "") for word in words], files))
        assert made[0] == made[1]


@pytest.mark.parametrize(
    ("text", "names", "outcome"),
    [
        ("inspect missing.png", ("missing.png",), "refused"),
        ("inspect missing.png", ("another.png",), "unclear"),
        ("inspect", ("x",), "refused"),
    ],
)
def test_a_refusal_must_name_its_input(text: str, names: tuple[str, ...], outcome: str) -> None:
    assert run_words(Case(tuple(text.split()), names))[0] == outcome


@pytest.mark.parametrize(
    ("code", "outcome", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "signal", "SIGSEGV"),
        ("import sys; sys.exit(3)", "signal", "code 3"),
        ("import time; time.sleep(60)", "hang", "no answer within 0.5 s"),
    ],
)
def test_a_process_that_dies_or_hangs_is_counted(tmp_path: Path, code: str, outcome: str, said: str) -> None:
    worker = Worker(tmp_path)
    worker.command = [sys.executable, "-c", f"input()\n{code}"]
    answer = worker.ask("target 0 0", 0.5 if outcome == "hang" else 10.0)
    assert answer["outcome"] == outcome
    assert said in answer["said"]
