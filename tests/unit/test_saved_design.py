"""The excitation of a saved design: taken as it is, changed, and refused where it cannot be."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.designs.excitation import designed_excitation
from amb_core.excitation import Multisine, Square
from amb_core.ground.errors import ExcitationError

DESIGNED = Multisine(amplitude=17.6e-6, duration=2.0, frequency_end=500.0, phasing="optimised", axes="x", seed=5)


def saved(folder: Path, **content: Any) -> Path:
    whole: dict[str, Any] = {"kind": "multisine", "parameters": DESIGNED.model_dump()}
    (folder / "summary.json").write_text(json.dumps(whole | content))
    return folder


def test_it_is_the_excitation_of_the_design(tmp_path: Path) -> None:
    assert designed_excitation(saved(tmp_path)) == DESIGNED
    square = Square(amplitude=1e-5, duration=1.0)
    assert designed_excitation(saved(tmp_path, kind="square", parameters=square.model_dump())) == square


def test_settings_change_it_but_the_amplitude_does_not_grow(tmp_path: Path) -> None:
    changed = designed_excitation(saved(tmp_path), {"seed": 2, "duration": 3.0, "amplitude": 1e-5})
    assert changed == DESIGNED.model_copy(update={"seed": 2, "duration": 3.0, "amplitude": 1e-5})
    with pytest.raises(ExcitationError, match=r"amplitude of 18 um is not allowed; .* 17\.6 um"):
        designed_excitation(tmp_path, {"amplitude": 18e-6})
    with pytest.raises(ExcitationError, match="cycles"):
        designed_excitation(tmp_path, {"cycles": 3})


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", "is not that of a design, as `amb excitation design` writes it"),
        ("[1]", "is not that of a design"),
        ('{"kind": "multisine"}', "is not that of a design.*'parameters'"),
        ('{"kind": "noise", "parameters": {}}', "unknown kind of excitation 'noise'"),
        ("[" * 100_000, "is not that of a design"),
    ],
)
def test_another_file_is_refused_in_one_line(tmp_path: Path, content: str, problem: str) -> None:
    (tmp_path / "summary.json").write_text(content)
    with pytest.raises(ExcitationError, match=problem) as refused:
        designed_excitation(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_command_takes_a_kind_a_design_or_a_list(tmp_path: Path) -> None:
    def refusal(*arguments: str) -> str:
        ended = CliRunner().invoke(app, ["experiment", *arguments, "--out", str(tmp_path / "out")])
        assert ended.exit_code == 1
        return " ".join(str(ended.exception or ended.output).split())

    one = "give one kind of excitation"
    assert one in refusal()
    assert one in refusal("multisine", "--design", str(saved(tmp_path)))
    assert "`amb excitation design` writes one" in refusal("--design", str(tmp_path / "none"))
    assert "--seed: not allowed with --file" in refusal("--file", "list.yaml", "--seed", "2")
