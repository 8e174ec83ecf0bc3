"""The samples do not depend on how the compiler vectorises the kernels."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN = """
import hashlib
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.excitation import Square, generate
from amb_core.plant.simulation import simulate
from amb_core.plant import Plant
signal = generate(Square(amplitude=50e-6, duration=0.1, frequency=20.0), 1e4)
record = simulate(Plant(), PdController(ControllerParameters()), 1_500, signal.samples, 500)
print(hashlib.sha256(record.position.tobytes() + record.current.tobytes()).hexdigest())
"""


@pytest.mark.slow  # compiles all kernels twice
def test_vectorised_and_plain_code_give_the_same_bits(tmp_path: Path) -> None:
    hashes = {
        subprocess.run(
            [sys.executable, "-c", RUN],
            env=os.environ | {"NUMBA_SLP_VECTORIZE": vectorise, "NUMBA_CACHE_DIR": str(tmp_path / vectorise)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for vectorise in ("0", "1")
    }
    assert len(hashes) == 1
