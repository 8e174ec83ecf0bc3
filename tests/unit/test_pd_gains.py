"""PD gains chosen for a machine hold the rotor at the centre; where no gains can, the reason is given."""

from pathlib import Path

import numpy as np
import pytest

from amb_core.designs.tuning.pd_gains import ENOUGH, choose_gains, held_at_centre
from amb_core.ground.errors import PlantError
from amb_core.loop.control import ControllerParameters
from amb_core.plant import (
    FlexibleRotorParameters,
    Plant,
    PlantParameters,
    RotorParameters,
    linearize,
    uniform_shaft,
)


def flexible(folder: Path, length: float, diameter: float, bearings: float) -> PlantParameters:
    modes = folder / "shaft.npz"
    uniform_shaft(length, diameter, (-bearings, bearings)).save(modes)
    return PlantParameters(
        rotor=RotorParameters(model="flexible"), flexible_rotor=FlexibleRotorParameters(modal_data=str(modes))
    )


@pytest.mark.parametrize("rotor", ["point_mass", "rigid"])
def test_chosen_gains_hold_the_rotor_at_the_centre_with_a_low_peak_sensitivity(rotor):
    plant = Plant(PlantParameters(rotor=RotorParameters(model=rotor)))
    chosen = choose_gains(plant)
    model = linearize(plant, chosen.controller)
    assert model.stable
    assert model.peak_sensitivity == pytest.approx(chosen.peak_sensitivity, rel=1e-3)
    assert chosen.peak_sensitivity <= ENOUGH
    assert np.abs(model.point.journals).max() < 1e-9


def test_the_operating_point_of_a_soft_shaft_between_its_bearings_is_found(tmp_path):
    """It bends by a multiple of what the journals may move."""
    plant = Plant(flexible(tmp_path, 1.5, 0.05, 0.75))
    model = linearize(plant, choose_gains(plant).controller)
    assert model.stable
    assert np.abs(model.point.journals).max() < 1e-8


def test_a_rotor_too_heavy_for_the_current_limit_is_refused():
    plant = Plant(PlantParameters(rotor=RotorParameters(mass=30.0)))
    with pytest.raises(PlantError, match=r"in the centre needs a control current of 4\.\d+ A; allowed: less than"):
        choose_gains(plant)


def test_a_nominal_reference_beyond_its_range_is_refused():
    """A soft controller: the current that carries the rotor takes more than the 1 mm that a reference may be."""
    plant = Plant()
    soft = ControllerParameters(proportional_gain=500.0)
    model = linearize(plant, ControllerParameters(), np.zeros(2))
    with pytest.raises(PlantError, match=r"takes a nominal reference of 1\.9.* mm with K_P = 500 A/m; allowed: 1 mm"):
        held_at_centre(plant, model, soft)


def test_gains_of_single_axes_are_replaced():
    given = ControllerParameters(proportional_gains=(1.0, 1.0), derivative_gains=(0.0, 0.0))
    chosen = choose_gains(Plant(), given).controller
    assert chosen.proportional_gains == chosen.derivative_gains == ()


def test_a_loop_that_no_gains_make_stable_is_refused():
    """A filter of 0.1 s leaves the derivative no effect on a rotor that falls within 5 ms."""
    with pytest.raises(PlantError, match="no PD gains of the grid make a stable loop"):
        choose_gains(Plant(), ControllerParameters(derivative_filter=0.1))


def test_the_controller_of_a_machine_with_a_thrust_bearing_has_a_reference_for_every_axis():
    plant = Plant(PlantParameters(rotor=RotorParameters(model="rigid", axial=True)))
    references = choose_gains(plant).controller.references(len(plant.machine.axes))
    assert len(references) == 5
    assert references[4] == 0.0
