"""The Python examples of explanation and reference run as they stand there, those of a page one after another."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from amb_core.data.experiments import IdentificationData
from amb_core.excitation import Multisine, generate
from amb_core.identification import identify
from amb_core.identification.validation import validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(
    page
    for part in ("explanation", "reference")
    for page in (DOCS / part).glob("*.md")
    if "```python" in page.read_text(encoding="utf-8")
)


@cache
def known() -> dict[str, Any]:
    """What the examples start from: an experiment, the model identified from it, and its validation."""
    controller = ControllerParameters()
    signal = generate(Multisine(amplitude=5e-6, duration=1.0, frequency_end=1_000.0), 10_000.0).samples
    record = simulate(Plant(), PdController(controller), 12_000, signal, excitation_step=2_000)
    data = IdentificationData.from_record(record, source="multisine").window(2_000, 12_000)
    result = identify(data, 8, controller=controller)
    return {
        "np": np,
        "result": result,
        "model": result.model,
        "uncertainty": result.uncertainty,
        "controller": controller,
        "validation": validate(result.model, data, controller),
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    examples = re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    assert examples
    names = dict(known())
    for example in examples:
        exec(example, names)
