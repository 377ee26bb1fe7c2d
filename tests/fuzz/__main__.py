"""``python -m tests.fuzz``: thousands of spoiled inputs through the command line; prints how they ended.

python -m tests.fuzz --cases 20000                   # all kinds of input, with two processes
python -m tests.fuzz recording log --cases 500       # some
python -m tests.fuzz recording --seed 3 --case 17    # one again, with what it said; --keep FOLDER keeps its files
"""

import argparse
import json
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .corpus import make_corpus  # type: ignore[import-not-found]
from .run import Failure, Run, fuzz, table  # type: ignore[import-not-found]
from .spoil import Spoiler  # type: ignore[import-not-found]
from .targets import TARGETS  # type: ignore[import-not-found]
from .worker import make_of, run_case  # type: ignore[import-not-found]

WEIGHTS = {"network": 0.15, "recording": 0.7, "parquet": 0.6, "dicom": 0.6}
"""Cases of a target where the others have one: some take longer, some have less to try."""


def _shares(targets: list[str], cases: int) -> dict[str, int]:
    weights = {target: WEIGHTS.get(target, 1.0) for target in targets}
    whole = sum(weights.values())
    return {target: -int(-cases * weight // whole) for target, weight in weights.items()}


def _again(target: str, seed: int, case: int, corpus: Path, keep: Path | None) -> int:
    answer = run_case(make_of(target, case), Spoiler(f"{target} {seed} {case}"), corpus, keep)
    print(json.dumps(answer["words"]), "\n", answer["said"])
    print({key: answer[key] for key in ("outcome", "seconds", "mib")})
    return answer["outcome"] not in ("ok", "refused")


def _hear(failure: Failure) -> None:
    print(f"{failure.outcome}: {failure.again}\n    {failure.last}", flush=True)


def main() -> int:
    """Returns 1 where any case ended as none may."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--cases", type=int, default=20_000, help="of all targets together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--case", type=int, help="only this one, in this process")
    parser.add_argument("--corpus", type=Path, help="folder of good files; made where there is none")
    parser.add_argument("--keep", type=Path, help="with --case: folder for its files")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no case later than this")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--json", type=Path, help="also write counts and failures")
    given = parser.parse_args()
    if unknown := set(given.targets) - set(TARGETS):
        parser.error(f"there is no target {', '.join(unknown)}; there are {', '.join(TARGETS)}")
    targets = given.targets or list(TARGETS)
    with tempfile.TemporaryDirectory() as made:
        corpus = (given.corpus or Path(made) / "corpus").resolve()
        if not corpus.exists():
            make_corpus(corpus)
        if given.case is not None:
            return _again(targets[0], given.seed, given.case, corpus, given.keep and given.keep.resolve())
        shares = _shares(targets, given.cases)
        until = time.monotonic() + 60 * given.minutes

        def share(target: str) -> Run:
            numbers = range(given.first, given.first + shares[target])
            return fuzz(corpus, [target], given.seed, lambda _: numbers, _hear, until)[0]

        with ThreadPoolExecutor(given.jobs) as pool:
            runs = list(pool.map(share, targets))
    print(table(runs))
    if given.json:
        failures = [vars(failure) for run in runs for failure in run.failures]
        counts = {run.target: {**run.outcomes, "seconds": run.seconds} for run in runs}
        given.json.write_text(json.dumps({"counts": counts, "failures": failures}, indent=2) + "\n")
    return any(run.failures for run in runs)


if __name__ == "__main__":
    sys.exit(main())
