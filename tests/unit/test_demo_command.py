"""`amb demo` as a user types it, up to where the graph starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from amb_bringup.commands.demo import demo
from amb_core.ground.errors import ParameterError


@pytest.mark.parametrize("content", [None, "/amb/simulator: {ros__parameters: {rotor.mas: 5.0}}\n"])
def test_a_wrong_parameter_file_leaves_the_results_of_an_earlier_demo(content: str | None, tmp_path: Path) -> None:
    kept = tmp_path / "out" / "model.json"
    kept.parent.mkdir()
    kept.write_text("{}")
    parameters = tmp_path / "my_bearing.yaml"
    if content is not None:
        parameters.write_text(content)
    with pytest.raises(ParameterError, match=r"my_bearing|rotor.mas"):
        demo(out=kept.parent, params=parameters)
    assert kept.read_text() == "{}"
