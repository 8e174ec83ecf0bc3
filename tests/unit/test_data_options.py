"""The options of data files are those of identify, validate and compare alike: one process from a .mat file by each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.client.request_fields import description_text
from amb_core.data.analysis import read
from amb_core.data.experiments import DataDescription
from amb_core.ground.errors import IdentificationError
from amb_core.linear import LinearSystem
from amb_core.loop.known_controller import LinearControl
from tests.linear_process import LinearProcess


def amb(*words: object) -> None:
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "160"})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception


@pytest.mark.parametrize("size", [(4, 4), (1, 1)])
def test_a_process_of_a_mat_file_is_identified_validated_and_compared(size: tuple[int, int], tmp_path: Path) -> None:
    m, p = size
    for name, seed in (("first", 1), ("second", 2)):
        item = LinearProcess(m, p).data(6_000, seed).experiments[0]
        savemat(tmp_path / f"{name}.mat", {"measured": np.hstack([item.inputs, item.outputs])})
    options = [
        "--variable",
        "measured",
        "--inputs",
        f"0-{m - 1}",
        "--outputs",
        f"{m}-{m + p - 1}",
        "--sample-time",
        0.5,
    ]
    models = []
    for order in (4, 6):
        models.append(tmp_path / f"order{order}.json")
        amb("identify", tmp_path / "first.mat", *options, "--order", order, "--method", "ssarx", "--out", models[-1])
    amb("validate", models[1], tmp_path / "second.mat", *options, "--results", tmp_path / "validated.json")
    assert json.loads((tmp_path / "validated.json").read_text())["verdict"] == "validated with reservations"
    drawn = ["--entries", "diagonal", "--figures", tmp_path / "figures"]
    amb("compare", *models, tmp_path / "second.mat", *options, "--results", tmp_path / "compared.json", *drawn)
    assert next(iter(json.loads((tmp_path / "compared.json").read_text())["models"])) == "order6"
    assert (tmp_path / "figures" / "bode.html").exists()
    with pytest.raises(IdentificationError, match=r"^entry 'i_x:x' is not allowed; allowed: diagonal, or input:output"):
        amb("compare", *models, tmp_path / "second.mat", *options, "--entries", "i_x:x")


def test_the_controller_of_a_saved_description_is_found_from_every_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one of a file in the folder where it was given, and after both have moved together."""
    here, elsewhere, saved = (tmp_path / name for name in ("here", "elsewhere", "here/saved"))
    for folder in (here, elsewhere, saved):
        folder.mkdir()
    monkeypatch.chdir(here)
    lag = LinearSystem(*np.array([[[0.5]], [[1.0]], [[1e4]], [[0.0]]]), 1e-4)
    LinearControl.of(lag).model.save("controller.json")
    rows = "\n".join(f"{k % 3},{k % 5}" for k in range(40))
    Path("rig.csv").write_text(f"i_x [A],x [um]\n{rows}\n")
    description = DataDescription.of(controller="controller.json", rate=1e4)
    assert DataDescription.given(description_text(description)).controller == str(here / "controller.json")
    for name in ("rig.yaml", "saved/rig.yaml"):
        description.save(name)
        assert str(tmp_path) not in Path(name).read_text()
        assert DataDescription.load(name).controller
        monkeypatch.chdir(elsewhere)
        assert isinstance(read(here / "rig.csv", here / name).controller, LinearControl)
        monkeypatch.chdir(here)
    here.rename(tmp_path / "moved")
    monkeypatch.chdir(elsewhere)
    assert isinstance(read("../moved/rig.csv", "../moved/saved/rig.yaml").controller, LinearControl)
