"""Linear controllers from elsewhere: matrices in a file, as MATLAB saves them, or a system of python-control."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.io import savemat

import amb_core as amb
from amb_core.data.controller_choice import named_controller, shown_limit
from amb_core.data.experiments import IdentificationData, write_data
from amb_core.ground.errors import ParameterError
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import UNLIMITED, LinearControl
from amb_core.loop.linear_control import LinearController, pd_as_linear
from tests.lqg_loop import linear_law, rotor

PERIOD = 1e-4
PID = {  # from the error, one axis: an integrator and a filtered derivative
    "A": [[1.0, 0.0], [0.0, 0.6]], "B": [[1.0], [1.0]], "C": [[40.0, -6e4]], "D": [[1.8e5]], "Ts": PERIOD,
}  # fmt: skip


def written(folder: Path, ending: str, content: dict[str, Any]) -> Path:
    path = folder / f"controller{ending}"
    if ending == ".mat":
        savemat(path, content)
    elif ending == ".npz":
        np.savez(path, **content)
    else:
        path.write_text(json.dumps(content))
    return path


def currents(controller: LinearControl, axes: int) -> np.ndarray:
    law = LinearController(controller.model, controller.parameters, axes, controller.sample_rate)
    motion = np.random.default_rng(2).normal(scale=1e-6, size=(50, 2, axes))
    return np.array([law.update(position, reference) for position, reference in motion])


@pytest.mark.parametrize("ending", [".mat", ".npz", ".json"])
def test_matrices_and_sample_time_are_a_controller(tmp_path: Path, ending: str) -> None:
    read = named_controller(str(written(tmp_path, ending, PID)), sample_rate=1.0 / PERIOD)
    assert isinstance(read, LinearControl)
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(read.model, name.lower()), PID[name])
    assert read.model.sample_time == PERIOD
    assert read.model.k.any()  # an anti-windup gain, which a controller with an integrator needs


@pytest.mark.parametrize("names", ["abcd dt", "abcd sample_time", "ABCD dt"])
def test_names_of_python_do_too(tmp_path: Path, names: str) -> None:
    matrices, time = names.split()
    content = dict(zip([*matrices, time], PID.values(), strict=True)) | {"plant": [1.0, 2.0]}
    assert LinearControl.load(written(tmp_path, ".npz", content)) == LinearControl.load(written(tmp_path, ".mat", PID))


def test_rows_and_columns_may_be_vectors(tmp_path: Path) -> None:
    flat = {**PID, "B": [1.0, 1.0], "C": [40.0, -6e4], "D": 1.8e5}
    assert LinearControl.load(written(tmp_path, ".json", flat)) == LinearControl.load(written(tmp_path, ".mat", PID))


def test_a_gain_alone_has_no_states(tmp_path: Path) -> None:
    gain = {"A": np.zeros((0, 0)), "B": np.zeros((0, 1)), "C": np.zeros((1, 0)), "D": [[2e4]], "Ts": PERIOD}
    read = LinearControl.load(written(tmp_path, ".mat", gain))
    assert read.model.order == 0
    np.testing.assert_allclose(currents(read, 1)[0, 0] / 2e4, currents(LinearControl.load(
        written(tmp_path, ".json", {**gain, "A": [], "B": [], "C": [], "D": 1.0})), 1)[0, 0])  # fmt: skip


def test_what_was_saved_whole_is_read_as_before(tmp_path: Path) -> None:
    model = pd_as_linear(ControllerParameters(), 2)
    for ending in (".json", ".npz", ".mat"):
        model.save(tmp_path / f"pd{ending}")
        read = LinearControl.load(tmp_path / f"pd{ending}").model
        assert (read.input_names, read.method) == (("r_0", "r_1", "y_0", "y_1"), "pd")


WITHOUT_TIME = {name: PID[name] for name in "ABCD"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (WITHOUT_TIME, "lacks Ts; a controller is A, B, C, D and its sample time Ts"),
        ({"P": [1.0], "Ts": PERIOD}, "lacks A, B, C, D; .*found P, Ts"),
        (PID | {"Ts": 0.0}, "'Ts' = .*0.* of a controller of continuous time there is none, sample it first"),
        (PID | {"Ts": -1.0}, "'Ts' = .*-1.* it must be the sample time in s"),
        (PID | {"a": PID["A"]}, "has A and a; allowed: one of them"),
        (PID | {"C": [[1.0, 2.0, 3.0]]}, r"'c' has shape \(1, 3\); \(1, 2\) is needed"),
        (PID | {"A": [[1.0, 0.0], [0.0, float("nan")]]}, "'a' holds values that are not finite"),
        (PID | {"A": "x"}, "'A' is no matrix of real numbers"),
        (PID | {"K": [[1.0, 2.0]]}, r"'k' has shape \(1, 2\); \(2, 1\) is needed"),
    ],
)
@pytest.mark.parametrize("ending", [".mat", ".json"])
def test_what_is_no_controller_is_named(tmp_path: Path, ending: str, content: dict[str, Any], message: str) -> None:
    path = written(tmp_path, ending, content)
    with pytest.raises(ParameterError, match=f"controller model {path}: {message}"):
        LinearControl.load(path)


def test_numbers_that_are_complex_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="'A' is no matrix of real numbers"):
        LinearControl.load(written(tmp_path, ".mat", PID | {"A": np.array(PID["A"]) * 1j}))


def test_a_design_of_python_control_is_a_controller_and_its_file_the_same(tmp_path: Path) -> None:
    design = control.ss(*(PID[name] for name in "ABCD"), PERIOD)
    known = LinearControl.of(design)
    assert known == LinearControl.load(written(tmp_path, ".mat", PID))
    known.model.save(tmp_path / "design.json")
    assert LinearControl.load(tmp_path / "design.json") == known
    assert LinearControl.of(LinearSystem.from_control(design)) == known


def test_a_system_of_continuous_time_is_refused_and_what_to_do_is_said() -> None:
    with pytest.raises(ParameterError, match="continuous time; sample it first"):
        LinearControl.of(control.ss(*(PID[name] for name in "ABCD")))
    with pytest.raises(ParameterError, match="sample time of the controller is not known"):
        LinearControl.of(control.ss(*(PID[name] for name in "ABCD"), True))
    with pytest.raises(ParameterError, match="controller: TransferFunction is not allowed"):
        LinearControl.of(control.tf([1.0], [1.0, 0.5], PERIOD))


def test_references_and_positions_have_their_names(tmp_path: Path) -> None:
    pd = pd_as_linear(ControllerParameters(), 2)
    read = LinearControl.load(written(tmp_path, ".mat", {
        "A": pd.a, "B": pd.b, "C": pd.c, "D": pd.d, "Ts": pd.sample_time,
    }))  # fmt: skip
    assert (read.model.input_names, read.model.output_names) == (pd.input_names, pd.output_names)
    np.testing.assert_allclose(currents(read, 2), currents(LinearControl(pd, read.parameters), 2))


def loop_of(law: StateSpaceModel, limit: float, amplitude: float = 60e-6) -> list[IdentificationData]:
    """Two experiments of a rotor of two axes whose currents reach 15 A, or a limit."""
    records = (rotor(2).record(linear_law(law, 2, limit), 8_000, seed, amplitude) for seed in (1, 2))
    return [IdentificationData.from_record(record) for record in records]


@pytest.mark.parametrize("limit", [100.0, 8.0])
def test_the_currents_show_the_limit_that_a_file_does_not_hold(tmp_path: Path, limit: float) -> None:
    law = rotor(2).lqg()
    content = {"A": law.a, "B": law.b, "C": law.c, "D": law.d, "Ts": law.sample_time}
    controller = str(written(tmp_path, ".mat", content))
    data, other = loop_of(law, limit)
    assert LinearControl.load(controller).current_limit == UNLIMITED
    assert shown_limit(data) == (None if limit == 100.0 else limit)
    for given in (controller, LinearControl.load(controller), control.ss(law.a, law.b, law.c, law.d, law.sample_time)):
        result = amb.identify(data, 6, "ssarx", given)
        assert result.controller.current_limit == limit
    assert np.all(amb.validate(result, other, controller).fit > 98.0)
    file = tmp_path / "data.csv"
    write_data(data, file)
    read = amb.read(file, controller=controller)
    assert read.controller.current_limit == pytest.approx(limit)


def test_gains_alone_have_the_limit_that_the_currents_show(bearing) -> None:
    data = IdentificationData.from_record(bearing.experiment(2e-8, force=0.1))  # reaches 3 A
    result = amb.identify(data, 6, controller="pd:20000,38")
    assert result.controller.current_limit == 3.0
    assert np.all(result.model.fit > 99.0)


def test_a_single_peak_is_no_limit(bearing) -> None:
    data = IdentificationData.from_record(bearing.experiment(2e-8, force=0.1, amplitude=10e-6))
    assert shown_limit(data) is None
    assert named_controller("pd:20000,38").current_limit > 50.0
