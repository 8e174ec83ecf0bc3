"""The plant computes in the thread that calls it, whatever the environment says about threads of BLAS."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import json, os, time

def threads():
    return len(os.listdir("/proc/self/task"))

from amb_core.plant import Plant, PlantParameters, RotorParameters

imported = threads()
for model in ("point_mass", "rigid"):
    plant = Plant(PlantParameters(rotor=RotorParameters(model=model)))
    axes = len(plant.position)
    plant.advance([0.0] * axes)
    plant.reset()
    process, thread = time.process_time(), time.thread_time()
    for _ in range(200):
        plant.advance([0.0, 0.8] * (axes // 2))
        plant.reset()
    process, thread = time.process_time() - process, time.thread_time() - thread
    print(json.dumps({"added": threads() - imported, "imported": imported, "elsewhere": process / thread - 1.0}))
"""
LIMITS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads as Linux lists them")


def _run(environment: dict[str, str]) -> list[dict[str, float]]:
    output = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, check=True, capture_output=True, text=True, timeout=120.0
    ).stdout
    return [json.loads(line) for line in output.splitlines()]


def test_with_one_thread_for_blas_the_process_has_one_thread() -> None:
    for result in _run(os.environ | dict.fromkeys(LIMITS, "1")):
        assert result["imported"] + result["added"] == 1


def test_without_limits_no_other_thread_works() -> None:
    environment = {name: value for name, value in os.environ.items() if name not in LIMITS}
    for result in _run(environment):
        # Waiting threads take no processor time; the two clocks differ by far less than a thread that spins.
        assert result["elsewhere"] < 0.05
