"""The part `same`: one experiment through bridge and emulator, and without either."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from amb_bringup.demos.demo_run import controller_of, plant_of
from amb_core.excitation import generate
from amb_core.loop.control import PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant.simulation import simulate
from amb_core.recording import Recording
from tests.soak.parts import MULTISINE, PATIENT, RIGID
from tests.soak.session import Session


def same(folder: Path, duration: float = 4.0, frequency_start: float = 2.0) -> dict[str, Any]:
    """One experiment through bridge and emulator, and without either: float64 bit for bit, float32 by its response."""
    multisine = MULTISINE.model_copy(update={"duration": duration, "frequency_start": frequency_start})
    identical, records = True, {}
    for float64 in (True, False):
        bridge = {"levitation_time": 0.0, "link": {"float64": float64}}
        with Session(folder, RIGID, target_emulator=PATIENT, hardware_bridge=bridge) as session:
            amb = session.amb
            amb.rig.connect()
            bag = Path(amb.start_recording(folder / f"same_{float64}"))
            run = amb.rig.levitate()
            amb.rig.wait_for_step(3_000)
            started = amb.start_excitation(multisine.kind, **multisine.model_dump())
            end = started.first_step + started.steps
            amb.rig.wait_for_step(end)
            amb.rig.land()
            amb.stop_recording(run, end)
        record = Recording.read(bag).telemetry(run).window(0, end)
        plant = plant_of(RIGID)
        samples = generate(multisine, plant.machine.sample_rate, plant.machine).samples
        law = PdController(controller_of(RIGID), 4)
        expected = simulate(plant, law, end, samples, started.first_step)
        if float64:
            identical = record.identical_to(expected)
        else:
            window = started.first_step, started.steps
            records = {"bridge": record.window(*window), "simulator": expected.window(*window)}
    return {"same": {"bit_identical": bool(identical), "frf_error_percent": _response_error(**records)}}


def _response_error(bridge: LoopRecord, simulator: LoopRecord) -> float:
    """Largest relative error of the responses to all axes, 5 to 1000 Hz, entries above 1 % of the largest (%)."""
    estimates = [_response(record) for record in (bridge, simulator)]
    frequency, measured = estimates[0]
    _, expected = estimates[1]
    size = np.abs(expected)
    in_band = (frequency >= 5) & (frequency <= 1000)
    counted = (size > 0.01 * size.max(axis=(1, 2), keepdims=True)) & in_band[:, None, None]
    return float(100.0 * (np.abs(measured - expected) / size)[counted].max())


def _response(record: LoopRecord) -> tuple[np.ndarray, np.ndarray]:
    """Response of the positions to the currents at the excited lines, from the last period of each experiment."""
    axes, experiments = len(record.axes), len(record.axes)
    steps = record.steps // experiments
    period = steps // MULTISINE.periods
    inputs, outputs, references = [], [], []
    for number in range(experiments):
        rows = slice(number * steps + steps - period, number * steps + steps)
        for signals, into in ((record.current, inputs), (record.position, outputs), (record.reference, references)):
            into.append(np.fft.rfft(signals[rows] - signals[rows].mean(axis=0), axis=0))
    u, y, r = (np.stack(signals, axis=2) for signals in (inputs, outputs, references))  # (lines, axes, experiments)
    power = np.abs(r).max(axis=(1, 2))
    excited = power > 1e-3 * power.max()
    frequency = np.fft.rfftfreq(period, record.sample_time)[excited]
    assert axes == u.shape[1]
    return frequency, y[excited] @ np.linalg.inv(u[excited])
