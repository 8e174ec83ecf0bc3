"""Results as plain values with named numbers, and as cards of notebooks."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.analysis import read
from amb_core.ground.results import VERSION, plain, unnamed
from amb_core.ground.results.names import NAMES
from amb_core.identification import identify
from amb_core.regions import Region
from amb_core.regions.distortion import DistortionSettings
from tests.benchmarks.first_hour.files import FOLDER

DATA = FOLDER / "with_reference.csv"
CONTROLLER = "pd:20000,38"


@dataclass
class Part:
    values: np.ndarray
    region: Region


def test_a_result_becomes_plain_values() -> None:
    result = {Region.B: Part(np.array([1.0, np.nan]), Region.C), "pole": 1 + 2j, "path": Path("a"), "n": np.int64(3)}
    expected = {"B": {"values": [1.0, None], "region": "C"}, "pole": [1.0, 2.0], "path": "a", "n": 3}
    assert plain(result) == expected
    assert plain(DistortionSettings()) == DistortionSettings().model_dump()
    with pytest.raises(TypeError, match="object is not a plain value"):
        plain([object()])


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    known, model = ("--controller", CONTROLLER), folder / "model.json"
    for words in (
        (
            "identify",
            DATA,
            *known,
            "--order",
            "2",
            "--out",
            folder / "model.json",
            "--results",
            folder / "identify.json",
        ),
        ("validate", model, DATA, *known, "--results", folder / "validate.json"),
        ("compare", model, DATA, *known, "--results", folder / "compare.json"),
        ("regions", DATA, *known, "--out", folder / "regions"),
    ):
        result = CliRunner().invoke(app, [str(word) for word in words])
        assert result.exit_code in (0, 3), result.output
    return folder


@pytest.mark.parametrize("name", ["identify.json", "validate.json", "compare.json", "regions/summary.json"])
def test_every_number_of_a_file_has_a_name_with_its_unit(files: Path, name: str) -> None:
    content = json.loads((files / name).read_text())
    assert next(iter(content)) == "version"
    assert content["version"] == VERSION
    assert unnamed(content) == []


def test_a_name_shows_percent_and_decibels_except_fit() -> None:
    endings = {"percent": "_percent", "dB": "_db"}
    assert [name for name, (unit, _) in NAMES.items() if not name.endswith(endings.get(unit, ""))] == ["fit"]


def test_results_show_themselves() -> None:
    loop = read(DATA, controller=CONTROLLER)
    result = identify(loop.data, 2, controller=loop.controller)
    for shown in (loop, result, result.validation):
        assert "\n" not in repr(shown)
        assert len(repr(shown)) < 400
        assert "<table><tr><th>" in shown._repr_html_()
    assert result.verdict in repr(result)
    assert "data:image/png;base64," in result._repr_html_()
    assert "data:image" not in loop._repr_html_(), "there is no chart of data"
    assert "the residuals are white" in result._repr_html_()
