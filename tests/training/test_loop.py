"""The training loop: what it promises to whoever waits for it, and to whoever must kill it."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.training import (
    TrainConfig,
    TrainingSamples,
    TrainResult,
    network_from_weights,
    network_weights,
    train_network,
    train_val_split,
)

Bars = Callable[..., TrainingSamples]


def trained(task: Any, samples: TrainingSamples, config: TrainConfig, **options: Any) -> TrainResult:
    return train_network(task, samples, train_val_split(samples.session, config), config, **options)


def same(a: TrainResult, b: TrainResult) -> bool:
    timeless = [
        [{k: v for k, v in row.items() if k in ("epoch", "loss", "validation_error_n")} for row in each.rows]
        for each in (a, b)
    ]
    equal = [np.array_equal(a.weights[name], b.weights[name]) for name in a.weights]
    return a.weights.keys() == b.weights.keys() and all(equal) and timeless[0] == timeless[1]


def test_it_learns(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    samples = bars(128)
    result = trained(tiny(), samples, quick.model_copy(update={"epochs": 15}))
    spread_n = float(np.mean(np.abs(samples.force_n - samples.force_n.mean(axis=0))))
    assert result.facts.validation_error_n < 0.5 * spread_n
    assert result.facts.validation_error_n == min(row["validation_error_n"] for row in result.rows)
    assert [row["epoch"] for row in result.rows] == list(range(1, 16))
    assert all(row["images_per_s"] > 0 and 0 <= row["waiting_share"] <= 1 for row in result.rows)


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_the_same_seed_is_the_same_network_however_many_threads_feed_it(
    tiny: Any, bars: Bars, quick: TrainConfig, precision: str
) -> None:
    config = quick.model_copy(update={"precision": precision})
    one = trained(tiny(), bars(), config)
    assert same(one, trained(tiny(), bars(), config.model_copy(update={"workers": 3})))
    assert not same(one, trained(tiny(), bars(), config.model_copy(update={"seed": 1})))


def test_what_is_drawn_hangs_on_seed_epoch_and_sample_alone(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    small, large = tiny(), tiny()
    trained(small, bars(), quick.model_copy(update={"batch": 4}))
    trained(large, bars(), quick)
    assert sorted(small.drawn) == sorted(large.drawn)
    assert len(set(small.drawn)) == len(small.drawn)


KILLED = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from conftest import Tiny, bars_drawn
from tipforce.training import TrainConfig, train_network, train_val_split
config, samples = TrainConfig.model_validate_json(sys.argv[3]), bars_drawn()
train_network(Tiny(), samples, train_val_split(samples.session, config), config, folder=Path(sys.argv[2]))
"""

PLAIN = {"optimiser": "sgd", "schedule": "plateau", "plateau_epochs": 2, "precision": "fp32"}
FULL = {"optimiser": "adamw", "schedule": "cosine", "average": 0.9, "clip_norm": 1.0, "rate": 0.002}


@pytest.mark.parametrize(
    "extra", [pytest.param(PLAIN, marks=pytest.mark.slow), FULL], ids=["sgd", "adamw with average"]
)
def test_a_killed_training_goes_on_to_the_same_result(
    tiny: Any, bars: Bars, quick: TrainConfig, tmp_path: Path, extra: dict[str, Any]
) -> None:
    config = quick.model_copy(update={"epochs": 8, **extra})
    whole = trained(tiny(), bars(), config)
    log, endless = tmp_path / "training.jsonl", config.model_copy(update={"epochs": 100_000, "patience": None})
    if config.schedule == "cosine":  # its rate hangs on the budget
        endless = config
    # one thread here, several there: what feeds the network is not what is compared
    words = [sys.executable, "-c", KILLED, str(Path(__file__).parent), str(tmp_path), endless.model_dump_json()]
    victim = subprocess.Popen(words, env={**os.environ})
    try:
        limit = time.monotonic() + 60
        while (not log.is_file() or log.read_text().count("\n") < 3) and time.monotonic() < limit:
            time.sleep(0.002)
    finally:
        victim.send_signal(signal.SIGKILL)
        victim.wait()
    finished = log.read_text().count("\n")
    assert finished >= 3
    if finished > config.epochs:
        pytest.skip("it was killed too late to go on from")
    with log.open("a") as stream:
        stream.write('{"epoch": 4, "lo')  # a line that the kill cut
    assert same(whole, trained(tiny(), bars(), config, folder=tmp_path, resume=True))
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    assert [row["epoch"] for row in rows] == list(range(1, 9))
    assert not list(tmp_path.glob("*.part"))


def test_it_stops_when_nothing_gets_better_and_keeps_the_best(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    hopeless = quick.model_copy(update={"epochs": 50, "patience": 2, "rate": 1e-12})
    result = trained(tiny(), bars(), hopeless)
    assert result.facts.epochs_run == result.facts.best_epoch + 2 < 50
    assert result.facts.stop_reason == "2 epochs brought no smaller error"
    hurried = quick.model_copy(update={"minutes": 1e-6})
    assert trained(tiny(), bars(), hurried).facts.stop_reason == "1e-06 minutes were up"
    assert trained(tiny(), bars(), quick).facts.stop_reason == "all epochs were run"


def test_a_plateau_halves_the_rate(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    still = quick.model_copy(update={"epochs": 6, "rate": 1e-30, "schedule": "plateau", "plateau_epochs": 2})
    scales = [row["rate_scale"] for row in trained(tiny(), bars(), still).rows]
    assert scales[0] == 1.0
    assert scales[-1] <= 0.5
    assert set(np.diff(np.log2(scales)).tolist()) <= {0.0, -1.0}


def test_training_that_diverges_says_so(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    with pytest.raises(InputError, match=r"diverged in epoch .*rate=1e\+29"):
        trained(tiny(), bars(), quick.model_copy(update={"rate": 1e30}))


def test_training_starts_from_other_weights(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    before = trained(tiny(), bars(), quick)
    still = quick.model_copy(update={"epochs": 1, "rate": 1e-30})
    after = trained(tiny(), bars(), still, init_from=before.weights)
    assert np.array_equal(after.weights["dense.weight"], before.weights["dense.weight"])
    assert after.facts.reinitialised_weights == []
    three = TrainingSamples(bars().images, np.zeros((64, 3), np.float32), bars().session)
    wider = trained(tiny(3), three, still, init_from=before.weights)
    assert wider.facts.reinitialised_weights == ["dense.weight", "dense.bias"]
    assert np.array_equal(wider.weights["body.0.weight"], before.weights["body.0.weight"])
    with pytest.raises(InputError, match=r"another network: body.0.weight has the shape \(8, 3, 5, 5\) here"):
        trained(tiny(), bars(), still, init_from={"dense.weight": before.weights["dense.weight"]})


def test_another_training_is_not_gone_on_with(tiny: Any, bars: Bars, quick: TrainConfig, tmp_path: Path) -> None:
    trained(tiny(), bars(), quick, folder=tmp_path)
    longer = quick.model_copy(update={"epochs": 4})
    assert len(trained(tiny(), bars(), longer, folder=tmp_path, resume=True).rows) == 4
    with pytest.raises(InputError, match=r"the settings differ \(rate=0.05, now rate=0.01\)"):
        trained(tiny(), bars(), quick.model_copy(update={"rate": 0.01}), folder=tmp_path, resume=True)
    with pytest.raises(InputError, match="the data differ"):
        trained(tiny(), bars(seed=1), quick, folder=tmp_path, resume=True)
    whole = (tmp_path / "training.jsonl").read_text()
    for line in ("{", "[" * 100_000, "[]"):
        (tmp_path / "training.jsonl").write_text(whole.partition("\n")[0] + f"\n{line}\n" + whole)
        with pytest.raises(InputError, match=r"training\.jsonl, line 2: .*; remove the folder .* and train anew"):
            trained(tiny(), bars(), quick, folder=tmp_path, resume=True)
    (tmp_path / "checkpoint.pt").write_bytes(b"nothing")
    with pytest.raises(InputError, match="is damaged"):
        trained(tiny(), bars(), quick, folder=tmp_path, resume=True)


def test_an_error_in_a_background_thread_is_not_lost(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    task = tiny()
    task.batch = lambda *_: 1 / 0
    with pytest.raises(ZeroDivisionError):
        trained(task, bars(), quick)


def test_progress_tells_what_a_person_asks(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    said: list[tuple[str, float]] = []
    trained(tiny(), bars(), quick, progress=lambda what, share: said.append((what, share)))
    assert said[-1][1] == 1.0
    assert [share for _, share in said] == sorted(share for _, share in said)
    for part in ("epoch 2/3", "mN (training ", "images/s", "waiting", "left"):
        assert part in said[-1][0]


def test_weights_make_the_same_network_again(tiny: Any, bars: Bars, quick: TrainConfig) -> None:
    result = trained(tiny(), bars(), quick)
    again = network_weights(network_from_weights(tiny(), result.weights))
    assert all(np.array_equal(again[name], value) for name, value in result.weights.items())
