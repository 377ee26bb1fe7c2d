"""The device that a network is trained on, and the optional packages that training needs."""

import importlib
import importlib.util
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..errors import MissingExtraError
from ._config import TrainConfig


def require_torch() -> None:
    """Checks that every package for training and export is installed, before any work is done.

    Raises:
        MissingExtraError: a package is missing.
    """
    for package in ("torch", "monai", "onnx", "onnxscript"):
        if importlib.util.find_spec(package) is None:
            raise MissingExtraError(package, extra="train")


@dataclass(frozen=True, slots=True)
class Device:
    """Device and precision of a training.

    Attributes:
        kind: "cuda" or "cpu".
        precision: "bf16" or "fp32".
        workers: number of threads that prepare batches.
        text: the device in words.
    """

    kind: str
    precision: str
    workers: int
    text: str


def choose_device(config: TrainConfig) -> Device:
    """Returns one CUDA device where there is one, else the CPU, with the precision that ``config`` requests."""
    import torch

    cuda = torch.cuda.is_available()
    has_bf16 = torch.cuda.is_bf16_supported() if cuda else cpu_has_bf16()
    precision = config.precision if config.precision != "auto" else ("bf16" if has_bf16 else "fp32")
    threads = torch.get_num_threads()
    workers = config.workers or (max(1, min(8, threads - 1)) if cuda else 1)
    text = torch.cuda.get_device_name() if cuda else f"CPU, {threads} thread{'s' if threads > 1 else ''}"
    return Device("cuda" if cuda else "cpu", precision, workers, text)


def cpu_has_bf16() -> bool:
    """Returns whether the processor multiplies in bf16. Emulated bf16 would be slower than fp32."""
    import torch

    # torch 2.13 has a public call for the capabilities of the processor, 2.11 has private ones only
    public = getattr(torch.cpu, "get_capabilities", None)
    if public is not None:
        capabilities: dict[str, Any] = public()
        return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))
    private = (getattr(torch.cpu, name, None) for name in ("_is_avx512_bf16_supported", "_is_amx_tile_supported"))
    return any(is_supported is not None and is_supported() for is_supported in private)


@contextmanager
def deterministic(device: Device) -> Generator[None]:
    """Makes torch compute the same in every run. The state of torch's generators is restored when the block ends."""
    import torch

    cudnn: Any = torch.backends.cudnn
    before = cudnn.deterministic, cudnn.benchmark
    with torch.random.fork_rng(devices=[torch.cuda.current_device()] if device.kind == "cuda" else []):
        cudnn.deterministic, cudnn.benchmark = True, False
        try:
            yield
        finally:
            cudnn.deterministic, cudnn.benchmark = before
