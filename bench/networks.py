"""``python -m bench.networks``: a frame to the network's answer, in every way there is to run it, beside the processor.

Each network has its first weights, after a few batches, since the time depends on the shapes alone. A frame is a
640 x 480 grey image in memory; the time of each way includes preprocessing, the batch axis and the conversion of the
input. The ways take turns, block by block; a row has the median of the quickest block, and p50 and p99 of all blocks,
which separates the cost of the way from the other load of the machine.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from bench.parts import run_alone

from tipforce.estimators import ESTIMATORS, NetworkEstimator, create
from tipforce.estimators.networks import Graph
from tipforce.training import export_graph, quantise
from tipforce.types import Observation, SessionInfo, ViewInfo

NETWORKS = ("dcfe", "compact")
FRAME = (480, 640)
THREADS = (1, 2)
BLOCKS = 12
BLOCK_S = 0.12
"""Time of a block of one way; a block has at least three frames."""
BATCH_SIZES = {"dcfe": 16, "compact": 64}
"""Batch size of the training steps that are timed."""
MATRIX_SIDE = 1024
"""Side of the matrices with which the speed of the processor is measured."""


def measure() -> dict[str, Any]:
    peaks = {str(threads): peak(threads) for threads in THREADS}
    figures = {name: of(name) for name in NETWORKS if name in ESTIMATORS}
    torch.set_num_threads(1)
    return {"peak_gflops": peaks, "networks": figures}


def peak(threads: int) -> dict[str, float]:
    """Returns billions of multiplications and additions a second in matrix products, with the quickest library."""
    torch.set_num_threads(threads)
    draw = np.random.default_rng(0)
    a, b = torch.rand(MATRIX_SIDE, MATRIX_SIDE), torch.rand(MATRIX_SIDE, MATRIX_SIDE)
    numbers, whole = _session(_product("MatMul", np.float32), threads), {"a": a.numpy()}
    few, short = _session(_product("MatMulInteger", np.uint8), threads), {"a": draw.integers(0, 256, a.shape, np.uint8)}
    ways = {
        "fp32": (lambda: torch.mm(a, b), lambda: numbers.run(None, whole)),
        "int8": (lambda: few.run(None, short),),
    }
    times = _rounds({f"{kind} {n}": work for kind, works in ways.items() for n, work in enumerate(works)}, blocks=6)
    best = {way: float(np.min(np.concatenate(blocks))) for way, blocks in times.items()}
    return {kind: 2e-9 * MATRIX_SIDE**3 / min(t for way, t in best.items() if way.startswith(kind)) for kind in ways}


def _product(kind: str, of: type[np.generic]) -> bytes:
    helper, number = onnx.helper, onnx.helper.np_dtype_to_tensor_dtype
    weights = np.random.default_rng(1).integers(-127, 128, (MATRIX_SIDE, MATRIX_SIDE))
    held = weights.astype(np.float32 if of is np.float32 else np.int8)
    answers = np.dtype(np.float32 if of is np.float32 else np.int32)
    graph = helper.make_graph(
        [helper.make_node(kind, ["a", "b"], ["y"])],
        "product",
        [helper.make_tensor_value_info("a", number(np.dtype(of)), [MATRIX_SIDE, MATRIX_SIDE])],
        [helper.make_tensor_value_info("y", number(answers), [MATRIX_SIDE, MATRIX_SIDE])],
        [onnx.numpy_helper.from_array(held, "b")],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8).SerializeToString()


def _session(data: bytes, threads: int) -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])


def of(name: str) -> dict[str, Any]:
    """Returns the times of one method's network in all ways, and the limits of the processor for it."""
    method = create(name)
    assert isinstance(method, NetworkEstimator)
    torch.manual_seed(0)
    task = method.task(np.array([True, True, False]), True, ())
    network = task.build()
    specs = dict(method.input_specs(training=False))
    _taught(network, specs)
    graph = export_graph(network, specs, method.outputs, {})
    small = quantise(graph, [_batch(specs, 1, seed) for seed in range(4)])
    draw = np.random.default_rng(0)
    image = np.clip(draw.normal(150, 40, FRAME), 0, 255).astype(np.uint8)
    info = SessionInfo(views={"camera": ViewInfo(base_side="left")})
    read, observation = method.reader(info, training=False), Observation(0, {"camera": image}, {})

    def ready() -> dict[str, Any]:
        row = read(observation)
        assert isinstance(row, dict)
        return {key: value[None] for key, value in row.items()}

    found = {
        "gflop": 1e-9 * operations(network, specs),
        "bytes": {"fp32 in half precision": len(graph), "int8": len(small)},
        "preprocessing_ms": _row(_rounds({"": ready})[""]),
        "threads": {str(threads): _ways(threads, network, graph, small, ready) for threads in THREADS},
    }
    return {**found, "training_images_per_s": training(name, method, task)}


def _ways(
    threads: int, network: torch.nn.Module, graph: bytes, small: bytes, ready: Callable[[], dict[str, Any]]
) -> dict[str, dict[str, float]]:
    torch.set_num_threads(threads)
    plain = network.eval()

    def eager(last: bool) -> Callable[[], Any]:
        layout = torch.channels_last if last else torch.contiguous_format

        def answer() -> Any:
            with torch.no_grad():
                return plain(**{key: torch.from_numpy(value) for key, value in ready().items()})

        def run() -> Any:
            plain.to(memory_format=layout)  # nothing to do but in a block's first frame
            return answer()

        return run

    def by(made: Graph) -> Callable[[], Any]:
        return lambda: made(**ready())

    ways = {"torch eager": eager(False), "torch eager, channels last": eager(True)}
    for kind, data in (("fp32", graph), ("int8", small)):
        ways[f"onnxruntime {kind}"] = by(Graph(data, kind, threads=threads))
    return {way: _row(blocks) for way, blocks in _rounds(ways).items()}


def _rounds(ways: dict[str, Callable[[], Any]], blocks: int = BLOCKS) -> dict[str, list[Any]]:
    """Seconds of every call, block by block, of ways that take turns."""
    found: dict[str, list[Any]] = {way: [] for way in ways}
    counts: dict[str, int] = {}
    for way, work in ways.items():
        work()
        began = time.perf_counter()
        work()
        counts[way] = max(3, int(BLOCK_S / (time.perf_counter() - began)))
    for _ in range(blocks):
        for way, work in ways.items():
            work()  # fills the caches again after the other ways
            times = np.empty(counts[way])
            for place in range(len(times)):
                began = time.perf_counter()
                work()
                times[place] = time.perf_counter() - began
            found[way].append(times)
    return found


def _row(blocks: list[Any]) -> dict[str, float]:
    """Returns milliseconds: the median of the quickest block, and p50 and p99 of all blocks."""
    whole = np.concatenate(blocks)
    best = min(float(np.median(block)) for block in blocks)
    values = {"best": best, "p50": float(np.median(whole)), "p99": float(np.percentile(whole, 99))}
    return {name: 1e3 * value for name, value in values.items()}


def _batch(specs: dict[str, Any], samples: int, seed: int) -> dict[str, Any]:
    draw = np.random.default_rng(seed)
    return {
        name: draw.integers(0, 256, (samples, *shape), np.uint8)
        if kind == "uint8"
        else draw.normal(size=(samples, *shape)).astype(np.float32)
        for name, (shape, kind) in specs.items()
    }


def _taught(network: torch.nn.Module, specs: dict[str, Any]) -> None:
    """Fills the statistics of batch norms: numbers that shrink from layer to layer would become denormal and slow."""
    network.train()
    with torch.no_grad():
        for seed in range(10):
            network(**{name: torch.from_numpy(array) for name, array in _batch(specs, 4, seed).items()})


def operations(network: torch.nn.Module, specs: dict[str, Any]) -> int:
    """Multiplications and additions of the convolutions and dense layers, of one sample."""
    total = 0

    def count(module: Any, _: Any, output: Any) -> None:
        nonlocal total
        total += 2 * output.numel() * module.weight[0].numel()  # of each number that comes out, a row of the weights

    layers = [module for module in network.modules() if isinstance(module, torch.nn.Conv2d | torch.nn.Linear)]
    hooks = [layer.register_forward_hook(count) for layer in layers]
    with torch.no_grad():
        network.eval()(**{name: torch.from_numpy(array) for name, array in _batch(specs, 1, 0).items()})
    for hook in hooks:
        hook.remove()
    return total


def training(name: str, method: NetworkEstimator, task: Any) -> dict[str, float]:
    """Images a second through forward, backward and a step, on two threads, by precision; images ready in memory."""
    torch.set_num_threads(2)
    specs = dict(method.input_specs(training=False))
    batch = {key: torch.from_numpy(value) for key, value in _batch(specs, BATCH_SIZES[name], 0).items()}
    found = {}
    for precision in ("fp32", "bf16"):
        network = task.build().to(memory_format=torch.channels_last).train()
        optimiser = torch.optim.SGD(network.parameters(), lr=1e-6)

        def step(network: Any = network, optimiser: Any = optimiser, bf16: bool = precision == "bf16") -> None:
            with torch.autocast("cpu", dtype=torch.bfloat16, enabled=bf16):
                outputs = network(**batch)
            answers = list(outputs) if isinstance(outputs, tuple) else [outputs]
            sum(answer.float().square().mean() for answer in answers).backward()  # type: ignore[union-attr]
            optimiser.step()
            optimiser.zero_grad(set_to_none=True)

        times = _rounds({"": step}, blocks=3)[""]
        found[precision] = BATCH_SIZES[name] / min(float(np.median(block)) for block in times)
    return found


def show(figures: dict[str, Any]) -> None:
    peaks = figures["peak_gflops"]
    for threads, peak_of in peaks.items():
        print(f"peak, {threads} thread{'s' * (threads != '1')}: " + _listed(peak_of, ".0f") + " GFLOP/s (GOP/s)")
    for name, found in figures["networks"].items():
        sizes = ", ".join(f"{way} {size / 1e6:.1f} MB" for way, size in found["bytes"].items())
        print(f"{name}: {found['gflop']:.2f} GFLOP a frame; {sizes}")
        print(f"  preprocessing {_listed(found['preprocessing_ms'], '.3f')} ms")
        for threads, ways in found["threads"].items():
            eager = min(row["best"] for way, row in ways.items() if way.startswith("torch"))
            print(f"  {threads} thread{'s' * (threads != '1')}, ms a frame with preprocessing:")
            for way, row in ways.items():
                speed = found["gflop"] / (1e-3 * row["best"])
                share = speed / peaks[threads]["int8" if way.endswith("int8") else "fp32"]
                print(
                    f"    {way:28} {_listed(row, '7.3f')}; {eager / row['best']:5.1f} x torch; "
                    f"{speed:4.0f} GFLOP/s, {share:4.0%} of the peak"
                )
        print(f"  training, images a second on 2 threads: {_listed(found['training_images_per_s'], '.0f')}")


def _listed(row: dict[str, float], form: str) -> str:
    return ", ".join(f"{name} {value:{form}}" for name, value in row.items())


if __name__ == "__main__":
    run_alone("networks", measure, show, __doc__)
