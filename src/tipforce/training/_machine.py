"""What there is to compute on."""

import importlib.util
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..errors import MissingExtraError
from ._recipe import TrainConfig

__all__ = ["Machine", "machine_for", "reproducible", "require_torch"]


def require_torch() -> None:
    """Raises MissingExtraError where something is not installed that training or what comes after it needs.

    To be asked before any work is done.
    """
    for package in ("torch", "monai", "onnx", "onnxscript"):
        if importlib.util.find_spec(package) is None:
            raise MissingExtraError(package, extra="train")


@dataclass(frozen=True, slots=True)
class Machine:
    """``device``: "cuda" or "cpu"; ``precision``: "bf16" or "fp32", of training; ``text`` says it to people."""

    device: str
    precision: str
    workers: int
    text: str


def machine_for(recipe: TrainConfig) -> Machine:
    """One CUDA device where there is one, else the CPU."""
    import torch

    cuda = torch.cuda.is_available()
    has_bf16 = torch.cuda.is_bf16_supported() if cuda else _cpu_has_bf16()
    precision = recipe.precision if recipe.precision != "auto" else ("bf16" if has_bf16 else "fp32")
    threads = torch.get_num_threads()
    workers = recipe.workers or (max(1, min(8, threads - 1)) if cuda else 1)
    where = torch.cuda.get_device_name() if cuda else f"CPU, {threads} thread{'s' if threads > 1 else ''}"
    return Machine("cuda" if cuda else "cpu", precision, workers, where)


def _cpu_has_bf16() -> bool:
    """Whether the processor multiplies in bf16: emulated, it would be slower than fp32."""
    import torch

    # torch 2.13 tells what the processor can do by a public call, 2.11 by private ones only
    told = getattr(torch.cpu, "get_capabilities", None)
    if told is not None:
        able: dict[str, Any] = told()
        return bool(able.get("avx512_bf16") or able.get("amx_bf16"))
    asked = (getattr(torch.cpu, name, None) for name in ("_is_avx512_bf16_supported", "_is_amx_tile_supported"))
    return any(ask is not None and ask() for ask in asked)


@contextmanager
def reproducible(machine: Machine) -> Generator[None]:
    """The same arithmetic in every run; torch's generators are as they were before when the block ends."""
    import torch

    cudnn: Any = torch.backends.cudnn
    before = cudnn.deterministic, cudnn.benchmark
    with torch.random.fork_rng(devices=[torch.cuda.current_device()] if machine.device == "cuda" else []):
        cudnn.deterministic, cudnn.benchmark = True, False
        try:
            yield
        finally:
            cudnn.deterministic, cudnn.benchmark = before
