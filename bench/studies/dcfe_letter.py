"""Method 2 to the letter on a GPU: all 461 images of the thesis protocol, 10,000 epochs, the 154 others tested.

    tipforce simulate --preset thesis-2021 --as dataset --samples 1836 --samples-per-session 153 --seed 0 -o SET
    python -m bench.studies.dcfe_letter SET -o OUT [--epochs 10000] [--every 500] [--seed 0]

The same network, loss (thesis eq. 19), order of the samples and learning rate as `tipforce evaluate dcfe --protocol
thesis --to-the-letter`, but one epoch is captured as a CUDA graph with all images on the GPU: its 15 steps of 31 images
would otherwise wait for their launches. It takes 13 minutes on an H100 in bf16. OUT/scores.jsonl has a line
every ``--every`` epochs: errors of Fx and Fy in mN on the test images against the force sensor, and on the training
images.
"""

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tipforce.datasets import open_dataset, thesis_split
from tipforce.estimators import Dcfe
from tipforce.estimators.networks._image_input import resize_to_resnet
from tipforce.training import ResnetTask


class Training:
    """One network with its optimiser: stochastic gradient descent with momentum, as `torch.optim.SGD` has it."""

    def __init__(self, images: torch.Tensor, force_n: torch.Tensor, settings: Any) -> None:
        self.images, self.force_n, self.settings = images, force_n, settings
        self.task = ResnetTask(force_n.shape[1])
        torch.manual_seed(settings.seed)
        self.network = self.task.build().to(images.device, memory_format=torch.channels_last)
        self.parameters = list(self.network.parameters())
        self.velocity = [torch.zeros_like(each) for each in self.parameters]
        steps = -(-len(images) // settings.batch)
        self.sizes = [len(part) for part in np.array_split(np.arange(len(images)), steps)]
        self.order = torch.zeros(len(images), dtype=torch.long, device=images.device)
        self.rates = torch.zeros(steps, device=images.device)
        self.loss_n = torch.zeros((), device=images.device)
        self.epoch = 0
        self.graph: Any = None

    def run_epoch(self) -> None:
        """Trains once on all images."""
        self.network.train()
        self._prepare()
        if self.graph is None and self.images.is_cuda:
            self._capture()
        if self.graph is None:
            self._steps()
        else:
            self.graph.replay()
        self.epoch += 1

    def predict(self, images: torch.Tensor) -> np.ndarray:
        """(n, 2) forces in newtons, in fp32."""
        self.network.eval()
        with torch.no_grad():
            return torch.cat([self.network(image=part)[0].cpu() for part in images.split(64)]).numpy()

    def _prepare(self) -> None:
        """Order and learning rates of this epoch, as `tipforce.training` has them."""
        order = np.random.default_rng((self.settings.seed, 2, self.epoch)).permutation(len(self.images))
        self.order.copy_(torch.from_numpy(order))
        done = (self.epoch + np.arange(len(self.sizes)) / len(self.sizes)) / self.settings.epochs
        rates = self.settings.rate * 0.5 * (1.0 + np.cos(np.pi * done))
        self.rates.copy_(torch.from_numpy(rates.astype(np.float32)))

    def _steps(self) -> None:
        self.loss_n.zero_()
        first = 0
        for step, size in enumerate(self.sizes):
            index = self.order[first : first + size]
            first += size
            with torch.autocast(self.images.device.type, torch.bfloat16, cache_enabled=False):
                force_n = self.network(image=self.images[index])[0]
            loss = self.task.loss((force_n.float(),), {"force_n": self.force_n[index]})
            gradients = torch.autograd.grad(loss, self.parameters)
            with torch.no_grad():
                torch._foreach_mul_(self.velocity, self.settings.momentum)
                torch._foreach_add_(self.velocity, list(gradients))
                torch._foreach_add_(self.parameters, torch._foreach_mul(self.velocity, -self.rates[step]))
                self.loss_n += loss.detach() * (size / len(self.images))

    def _capture(self) -> None:
        """Captures an epoch, after two epochs for warm-up whose changes are undone."""
        kept = {name: value.clone() for name, value in self.network.state_dict().items()}
        velocity = [value.clone() for value in self.velocity]
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(2):
                self._steps()
        torch.cuda.current_stream().wait_stream(stream)
        self.graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self.graph):
            self._steps()
        self.network.load_state_dict(kept)
        for value, before in zip(self.velocity, velocity, strict=True):
            value.copy_(before)


def errors_mn(found_n: np.ndarray, wanted_n: np.ndarray) -> dict[str, list[float]]:
    """RMSE, mean, smallest and largest error of each component in mN."""
    error = 1e3 * np.abs(found_n - wanted_n).astype(np.float64)
    rows = {"rmse": np.sqrt((error**2).mean(axis=0)), "mae": error.mean(axis=0)}
    rows |= {"min": error.min(axis=0), "max": error.max(axis=0)}
    return {name: np.round(row, 3).tolist() for name, row in rows.items()}


def main() -> None:
    """Trains and writes OUT/scores.jsonl."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--epochs", type=int, default=10_000)
    parser.add_argument("--every", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0, help="of the initial weights and the order")
    options = parser.parse_args()
    stated = {**(Dcfe.thesis_settings or {}), "epochs": options.epochs, "seed": options.seed}
    settings = Dcfe.settings_type.model_validate(stated)
    data = open_dataset(options.data)
    split = thesis_split(data, Dcfe.thesis_samples)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    torch.backends.cudnn.benchmark = True
    images, force_n = {}, {}
    for name, index in (("train", split.train), ("test", split.test)):
        part = data.subset(index)
        views = [resize_to_resnet(each.views["camera"]) for each in part.observations()]
        images[name] = torch.from_numpy(np.stack(views)).to(device)
        force_n[name] = part.force_n[:, :2].astype(np.float32)
    training = Training(images["train"], torch.from_numpy(force_n["train"]).to(device), settings)
    options.output.mkdir(parents=True, exist_ok=True)
    constant = np.broadcast_to(force_n["train"].mean(axis=0), force_n["test"].shape)
    print("constant predictor:", json.dumps(errors_mn(constant, force_n["test"])), flush=True)
    began = time.monotonic()
    while training.epoch < options.epochs:
        training.run_epoch()
        if training.epoch % options.every and training.epoch < options.epochs:
            continue
        row = {"epoch": training.epoch, "loss_mn": round(1e3 * float(training.loss_n), 3)}
        row |= {name: errors_mn(training.predict(images[name]), force_n[name]) for name in ("test", "train")}
        row |= {"seconds": round(time.monotonic() - began, 1)}
        print(json.dumps(row), flush=True)
        with (options.output / "scores.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        if not math.isfinite(row["loss_mn"]):
            raise SystemExit("training diverged")


if __name__ == "__main__":
    main()
