"""Lists of experiments: quantities with units, and the entry that is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from amb_bringup.experiments.experiment_list import read_experiments
from amb_core.excitation import Multisine, Sweep, Tones
from amb_core.ground.errors import ExcitationError


def written(folder: Path, text: str) -> Path:
    path = folder / "list.yaml"
    path.write_text(text)
    return path


def test_entries_become_experiments_in_si_units(tmp_path: Path) -> None:
    text = """
    - {kind: multisine, amplitude: 10um, duration: 4s, seed: 3}
    - {name: fast, kind: sweep, amplitude: 2.0e-6, duration: 500ms, frequency_end: 1kHz, axes: x}
    - {kind: tones, duration: 1, frequencies: [10, 1kHz], amplitudes: [1um, 2um]}
    """
    multisine, sweep, tones = read_experiments(written(tmp_path, text))
    assert (multisine.name, sweep.name) == ("1 multisine", "fast")
    assert multisine.excitation == Multisine(amplitude=1e-5, duration=4.0, seed=3)
    assert sweep.excitation == Sweep(amplitude=2e-6, duration=0.5, frequency_end=1000.0, axes="x")
    assert tones.excitation == Tones(duration=1.0, frequencies=(10.0, 1000.0), amplitudes=(1e-6, 2e-6))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("kind: multisine", r"must be a list, one entry as '- kind: multisine'"),
        ("- multisine", r"entry 1: must be a mapping with kind and settings"),
        ("- {kind: noise}", r"entry 1: unknown kind of excitation 'noise'; allowed: sweep"),
        ("- {kind: square, duration: 1}", r"entry 1: square has no default for 'amplitude'"),
        ("- {kind: square, amplitude: 5kg, duration: 1}", r"entry 1: '5kg' has the unit 'kg'; allowed: a number in m"),
        ("- {kind: square, amplitude: 1, duration: 1}", r"entry 1: parameter 'amplitude' = 1 is not allowed"),
        ("- {kind: square, amplitude: 1um, duration: 0}", r"entry 1: parameter 'duration' = 0 is not allowed"),
        ("- {kind: square, amplitude: 1um, duration: 1, frequency: 0Hz}", r"'frequency' = 0.0 is not allowed"),
        ("- {kind: sweep, amplitude: 1um, duration: 1, frequency_start: 0}", r"'frequency_start' = 0 is not allowed"),
        ("- [", r"cannot be read"),
    ],
)
def test_a_wrong_list_is_refused_with_file_and_entry(text: str, problem: str, tmp_path: Path) -> None:
    with pytest.raises(ExcitationError, match=problem) as refusal:
        read_experiments(written(tmp_path, text))
    assert "list.yaml" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_names_are_unique(tmp_path: Path) -> None:
    entry = "- {name: one, kind: square, amplitude: 1um, duration: 1}\n"
    with pytest.raises(ExcitationError, match="the name 'one' is given 2 times"):
        read_experiments(written(tmp_path, 2 * entry))
