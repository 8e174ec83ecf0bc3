"""Models of the bearing's two axes stay what they were: the same bits.

`data/two_axes.npz` has what the code gave, and on which arithmetic: `pem` since it moves F between about equal modes,
the others since before models of any number of axes, to rounding. There the bits are compared; on other processors and
libraries, which round otherwise, the responses.

`python tests/unit/test_identification_two_axes.py` writes the file again.
"""

from __future__ import annotations

import platform
from pathlib import Path

import llvmlite.binding
import numba
import numpy as np
import pytest
import scipy
from threadpoolctl import threadpool_info

from amb_core.identification import METHODS, IdentificationData, identify, response_of, select_order
from amb_core.identification.estimate.arx import arx

KEPT = Path(__file__).parent / "data" / "two_axes.npz"
MATRICES = ("a", "b", "c", "k", "innovation_covariance", "initial_state")
FREQUENCIES = np.geomspace(5.0, 1_000.0, 20)  # Hz
ORDER = 6


def arithmetic() -> str:
    """What decides how results are rounded."""
    blas = sorted(
        f"{item['internal_api']} {item['version']} {item.get('architecture', '')}" for item in threadpool_info()
    )
    versions = f"numpy {np.__version__}, scipy {scipy.__version__}, numba {numba.__version__}"
    return f"{platform.machine()} {llvmlite.binding.get_host_cpu_name()}; {versions}; {', '.join(dict.fromkeys(blas))}"


def results(bearing) -> dict[str, np.ndarray]:
    """Models of all methods, the uncertainty of `pem`, and the criteria of order, from squares of 20 Hz."""
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    data = IdentificationData.from_record(record)
    identifications = {method: identify(data, ORDER, method) for method in METHODS}
    models = {method: result.model for method, result in identifications.items()}
    models["arx"] = arx(record.current, record.position, record.sample_time, 8)
    kept = {f"{name}.{matrix}": getattr(model, matrix) for name, model in models.items() for matrix in MATRICES}
    kept |= {f"{name}.response": response_of(model, FREQUENCIES).response for name, model in models.items()}
    uncertainty = identifications["pem"].uncertainty
    assert uncertainty is not None
    kept["pem.deviation"] = uncertainty.response(FREQUENCIES).magnitude_deviation
    return kept | {"order.bic": select_order(data, (5, 6, 7)).bic}


@pytest.fixture(scope="module")
def now(bearing) -> dict[str, np.ndarray]:
    return results(bearing)


def test_the_responses_are_what_they_were(now: dict[str, np.ndarray]) -> None:
    with np.load(KEPT) as before:
        for name in before.files:
            if name.endswith(("response", "deviation")):
                assert np.abs(now[name] - before[name]).max() < 1e-6 * np.abs(before[name]).max(), name
        assert np.argmin(now["order.bic"]) == np.argmin(before["order.bic"])


def test_the_bits_are_what_they_were_on_the_same_arithmetic(now: dict[str, np.ndarray]) -> None:
    with np.load(KEPT) as before:
        if str(before["arithmetic"]) != arithmetic():
            pytest.skip(f"the kept results are of {before['arithmetic']}, not {arithmetic()}")
        differing = [name for name in now if now[name].tobytes() != before[name].tobytes()]
    assert not differing


if __name__ == "__main__":
    from conftest import LinearBearing  # type: ignore[import-not-found]

    np.savez_compressed(KEPT, arithmetic=np.array(arithmetic()), **results(LinearBearing()))
