"""Certificates computed again from certificate.json, model and bag in another folder: how many are the same."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

from amb_core.data.experiments import write_data
from amb_core.identification import identify
from amb_core.report.pages.again import certify_again
from amb_core.report.pages.certificate import write_certificate
from amb_core.report.pages.certification import Request, certify_request
from amb_core.robustness import RobustnessSettings
from amb_core.robustness.trace import CertificateHeader
from tests.benchmarks.robust.hidden_modes import STEP, in_si, rotor
from tests.benchmarks.robust.records import Size, records

CERTIFICATES = 10
PARAMETERS = "/amb/pd_controller: {ros__parameters: {derivative_filter: 1.0e-4, derivative_on: measurement}}\n"


def again(size: Size) -> dict[str, int]:
    """How many certificates are the same."""
    count = min(CERTIFICATES, size.runs)
    kept = records("again", size, count, lambda seed: {"equal": is_equal(seed, size)})
    return {"certificates": count, "equal": sum(item["equal"] for item in kept)}


def is_equal(seed: int, size: Size) -> bool:
    """Identify, certify, move the files, certify again."""
    random = np.random.default_rng([seed, 7])
    loop = rotor(float(random.uniform(300.0, 1_500.0)), 0.01, 0.03)
    reference = 4e-6 * np.sign(random.normal(size=(size.steps // 20, 2))).repeat(20, axis=0)
    data = in_si(*loop.run(reference, random), STEP, reference)
    settings = RobustnessSettings(
        frequencies=float(size.frequencies), extra_delay=float(random.choice([0.0, 0.5, 1.0]))
    )
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder) / "first", Path(folder) / "second"
        first.mkdir()
        identify(data, 8).model.save(first / "model.json")
        write_data(data, first / "data.npz")
        (first / "law.yaml").write_text(PARAMETERS)
        paths = {name: str(first / name) for name in ("model.json", "law.yaml", "data.npz")}
        request = Request(
            paths["model.json"],
            paths["law.yaml"],
            paths["data.npz"],
            experiment_controller=paths["law.yaml"],
            settings=settings,
            header=CertificateHeader(machine=f"rotor {seed}"),
        )
        write_certificate(certify_request(request), first)
        shutil.move(first, second)
        return not certify_again(second / "certificate.json").differences
