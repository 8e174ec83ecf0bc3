"""A controller sample of 100 us of the same rotor in ROSS and here: two magnetic bearings, seven nodes.

ROSS integrates all degrees of freedom of its nodes by the Newmark method in steps of 100 us, with linear magnetic
bearings and their PID controller (`run_time_response`). Ours are the modes that `amb plant ross` takes by default, in
nonlinear magnetic circuits with pulse-width modulation at steps of 0.5 us, and the PD controller.

Blocks of both alternate, so that both see the same machine, and the fastest block of each counts. What ROSS needs once
per call, such as building matrices, is left out by the difference of two lengths.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.designs.tuning.pd_gains import choose_gains
from amb_core.ground.errors import PlantError
from amb_core.loop.control import PdController
from amb_core.plant import FlexibleRotorParameters, Plant, PlantParameters, RotorParameters, modal_data_from_ross
from amb_core.plant.ross_source import ross_rotor
from tests.benchmarks.skipped import Skipped

LENGTH, DIAMETER, NODES, BEARINGS = 0.6, 0.05, 7, (1, 5)  # m, m, -, nodes
BLOCKS, SHORT, LONG = 12, 500, 2500  # steps of a call of ROSS
STEP = 1e-4  # s
FORCE, FREQUENCY = 5.0, 60.0  # N, Hz; on the middle node in ROSS, so that its iterations have work
MOST = 200e-6  # m; both rotors must stay in their bearings


def measure(blocks: int = BLOCKS) -> dict[str, float | bool]:
    """Time of one step (us) of both, and ROSS's over ours.

    Raises
    ------
    Skipped
        If ROSS is not installed.
    RuntimeError
        If one of the rotors leaves its bearings.
    """
    ross, rotor = _ross_rotor()
    plant, controller = _machine(rotor)
    suspended = _with_bearings(ross, rotor, plant.parameters, controller)
    _time_response(suspended, SHORT)  # compiles
    _simulation(plant, controller, LONG)
    short, long, ours = [], [], []
    for _ in range(blocks):
        short.append(_time_response(suspended, SHORT))
        long.append(_time_response(suspended, LONG))
        ours.append(_simulation(plant, controller, LONG))
    ross_us = 1e6 * (min(long) - min(short)) / (LONG - SHORT)
    ours_us = 1e6 * min(ours) / LONG
    return {"ratio": ross_us / ours_us, "ross_us": ross_us, "ours_us": ours_us}


def shaft() -> Any:
    """The rotor without bearings, a steel shaft; `ross_rotor` calls this."""
    ross = sys.modules["ross"]
    steel = ross.Material("steel", rho=7810.0, E=211e9, G_s=81.2e9)
    length = LENGTH / (NODES - 1)
    return ross.Rotor([ross.ShaftElement(length, 0.0, DIAMETER, material=steel) for _ in range(NODES - 1)])


def _ross_rotor() -> tuple[Any, Any]:
    try:
        ross_rotor("ross:rotor_example")
    except PlantError as problem:
        if "not installed" in str(problem):
            raise Skipped("ROSS is not installed; make setup EXTRAS=ross adds it") from None
        raise
    return sys.modules["ross"], shaft()


def _machine(rotor: Any) -> tuple[Plant, PdController]:
    with tempfile.TemporaryDirectory() as folder:
        modes = Path(folder) / "rotor.npz"
        modal_data_from_ross(rotor, BEARINGS).save(modes)
        flexible = FlexibleRotorParameters(modal_data=str(modes))
        plant = Plant(PlantParameters(rotor=RotorParameters(model="flexible"), flexible_rotor=flexible))
        return plant, PdController(choose_gains(plant).controller, len(plant.machine.axes))


def _with_bearings(ross: Any, rotor: Any, plant: PlantParameters, controller: PdController) -> Any:
    """The rotor in ROSS's linear magnetic bearings, of the same k_i, k_s and PD gains."""
    circuit, gains = plant.magnetic_circuit, controller.parameters
    bearings = [
        ross.MagneticBearingElement(
            n=node, g0=circuit.air_gap, i0=plant.amplifier.bias_current, ag=circuit.pole_width * circuit.axial_length,
            nw=2 * circuit.turns_per_pole, alpha=np.pi / 8,
            kp_pid=gains.proportional_gain, kd_pid=gains.derivative_gain, ki_pid=0.0,
        )
        for node in BEARINGS
    ]  # fmt: skip
    return ross.Rotor(rotor.shaft_elements, [], bearings)


def _time_response(rotor: Any, steps: int) -> float:
    """Duration of a time response of ROSS (s)."""
    time_ = STEP * np.arange(steps)
    force = np.zeros((steps, rotor.ndof))
    force[:, rotor.number_dof * (NODES // 2)] = FORCE * np.sin(2.0 * np.pi * FREQUENCY * time_)
    with contextlib.redirect_stdout(io.StringIO()):
        started = time.perf_counter()
        response = rotor.run_time_response(0.0, force, time_, method="newmark")
        duration = time.perf_counter() - started
    journals = [rotor.number_dof * node + axis for node in BEARINGS for axis in (0, 1)]
    if not np.abs(response.yout[:, journals]).max() < MOST:
        raise RuntimeError("the rotor in ROSS leaves its bearings")
    return duration


def _simulation(plant: Plant, controller: PdController, steps: int) -> float:
    """Duration of the same number of samples of ours (s), controller included."""
    plant.reset()
    controller.reset()
    reference = controller.nominal_reference
    started = time.perf_counter()
    for _ in range(steps):
        plant.advance(controller.update(plant.position, reference))
    duration = time.perf_counter() - started
    if plant.delevitated:
        raise RuntimeError("our rotor leaves its bearings")
    return duration


if __name__ == "__main__":
    print(measure())
