"""A graph of unknown origin is first run in a separate process, with limits of time and memory.

Without loops and branches the cost of a graph does not depend on the image, so one run shows it. A crash of the runtime
ends that process alone.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

TRIAL_S = 60.0
"""Time for loading a graph and one run on one core; `dcfe` takes 1 s."""
TRIAL_BYTES = 4 << 30
"""Memory (address space) for that; `dcfe` takes 0.4 GiB."""


def try_graph(path: Path) -> None:
    """Loads a graph and runs it once on zeros, in a process of its own.

    Raises:
        ModelError: it takes longer than `TRIAL_S` or more memory than `TRIAL_BYTES`, crashes, or is refused.
    """
    from ..._system.processes import run_child  # here, because this file is also a program outside of any package
    from ...errors import ModelError

    # -P: nothing is imported from the current folder
    command = [sys.executable, "-P", __file__, str(path), str(TRIAL_BYTES)]
    try:
        done = run_child(command, capture=True, timeout_s=TRIAL_S)
    except subprocess.TimeoutExpired:
        raise ModelError(f"{path.name}: one run took more than {TRIAL_S:g} s; train the model again") from None
    if done.returncode:
        message = " ".join((done.stderr or "").split())
        if "MemoryError" in message or "allocate" in message:
            reason = f"takes more than {TRIAL_BYTES >> 30} GiB of memory"
        else:
            reason = f"cannot be run ({message[:200] or f'it ends with the code {done.returncode}'})"
        raise ModelError(f"{path.name}: {reason}; copy the whole model folder again, or train the model again")


def _run(path: Path, limit_bytes: int) -> None:
    """Loads a graph and runs it on zeros, in the separate process with limited memory, one thread, no core dump."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # each thread takes address space
        os.environ[name] = "1"
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (limit_bytes, limit_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import numpy as np
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    session: Any = onnxruntime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
    kinds = {"tensor(uint8)": np.uint8, "tensor(float)": np.float32}
    inputs = {
        each.name: np.zeros([length if isinstance(length, int) else 1 for length in each.shape], kinds[each.type])
        for each in session.get_inputs()
    }
    session.run(None, inputs)


if __name__ == "__main__":
    try:
        _run(Path(sys.argv[1]), int(sys.argv[2]))
    except Exception as error:  # each kind that a runtime raises, as one line
        sys.exit(f"{type(error).__name__}: {error}")
