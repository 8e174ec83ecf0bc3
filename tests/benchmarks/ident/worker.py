"""One identification in a process of its own: `worker.py MODULE METHOD DATA RESULT` with the data in an .npz file.

The result holds the matrices of the model, the processor seconds of the identification, which on a free core and with
one thread are those of the clock, and the largest memory of the process (MB), imports included. A first identification
of a part of the data, whose time does not count, loads what a method compiles or imports when it is first used.
"""

from __future__ import annotations

import importlib
import resource
import sys
import time

import numpy as np

_WARM_UP_STEPS = 4_000


def main(module: str, method: str, data: str, result: str) -> None:
    """Identify and save; what the method raises ends the process with its message on stderr."""
    methods = importlib.import_module(module)
    with np.load(data) as archive:
        inputs, outputs, order = archive["inputs"], archive["outputs"], int(archive["order"])
        sample_time = float(archive["sample_time"])
    try:
        methods.identify(method, inputs[:_WARM_UP_STEPS], outputs[:_WARM_UP_STEPS], sample_time, order)
    except Exception as problem:  # short data may be too little for a method
        print(f"warm-up: {problem}", file=sys.stderr)
    started = time.process_time()
    matrices = methods.identify(method, inputs, outputs, sample_time, order)
    seconds = time.process_time() - started
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    np.savez(result, seconds=seconds, peak_mb=megabytes, **matrices)


if __name__ == "__main__":
    main(*sys.argv[1:])
