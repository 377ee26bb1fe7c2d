"""The choice of the device, and the message where a package is missing."""

import importlib.util
from typing import Any

import numpy as np
import pytest

from tipforce.errors import MissingExtraError
from tipforce.training import TrainConfig, TrainingSamples, train_network, train_val_split
from tipforce.training._device import choose_device


@pytest.mark.parametrize("missing", ["torch", "monai", "onnxscript"])
def test_a_missing_package_is_told_before_the_work(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == missing else find(name) or True)
    samples = TrainingSamples(np.zeros((4, 8, 8, 3), np.uint8), np.zeros((4, 2), np.float32), np.repeat("s", 4))
    with pytest.raises(MissingExtraError, match=rf"{missing} is not installed; .*'\.\[train\]'"):
        train_network(None, samples, train_val_split(samples.session, TrainConfig()), TrainConfig())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("able", "precision"), [({"avx512_bf16": True}, "bf16"), ({"amx_bf16": True}, "bf16"), ({"avx2": True}, "fp32")]
)
def test_bf16_only_where_the_processor_computes_in_it(
    able: dict[str, bool], precision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch: Any = pytest.importorskip("torch", reason="training needs the extra [train]")
    if torch.cuda.is_available():
        pytest.skip("a CUDA device is taken before the processor")
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: able, raising=False)
    assert choose_device(TrainConfig()).precision == precision
    assert choose_device(TrainConfig(precision="fp32")).precision == "fp32"
    # torch 2.11 has no such call
    monkeypatch.delattr(torch.cpu, "get_capabilities")
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: precision == "bf16", raising=False)
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: False, raising=False)
    assert choose_device(TrainConfig()).precision == precision
