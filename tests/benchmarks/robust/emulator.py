"""Sensitivity measured by a swept sine on an emulated rig, compared with the model identified there.

`python -m tests.benchmarks.robust.emulator` adds it to results/bench_robust.json, as `swept.emulator`.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from amb_bringup.client.experiment import Experiment
from amb_bringup.experiments.experiment_session import GraphChoice, run_session
from amb_core.data.analysis import RecordedLoop, read
from amb_core.excitation import Excitation, excitation_from_request
from amb_core.identification import identify
from amb_core.robustness import SweepSettings, feedback_of, measured_sensitivity
from tests.benchmarks.robust.records import Size
from tests.benchmarks.robust.run import SMALLEST
from tests.benchmarks.robust.swept import AMPLITUDE, IDENTIFICATION, compared
from tests.front_door.results import Results
from tests.graph.rig import free_port

SLOW = """
/amb/target_emulator:
  ros__parameters:
    {{port: {port}, real_time_factor: 0.2, plant_waits: true, limits: {{missed_steps: 1.0e9, host_time: 1.0e3}}}}
/amb/hardware_bridge:
  ros__parameters: {{link: {{port: {port}, timeout: 30.0, silence: 20.0}}}}
"""  # of docs/how-to/connect-a-rig.md: an ordinary computer does not keep real time


def slow_rig(port: int) -> str:
    """Parameters of a slow rig with a port of its own, as other programs run beside it."""
    return SLOW.format(port=port)


def main() -> None:
    """Identify, sweep, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    quick = parser.parse_args().quick
    results = Results("bench_robust.json", quick)
    size = replace(Size(results.file.with_suffix("")), **SMALLEST if quick else {})
    with tempfile.TemporaryDirectory() as folder:
        parameters = Path(folder) / "slow.yaml"
        parameters.write_text(slow_rig(free_port()))
        rig = GraphChoice(parameters, rig=True, emulator=True)
        identification = excitation_from_request("multisine", IDENTIFICATION | {"duration": size.identification})
        used = _record(identification, Path(folder) / "multisine", rig)
        swept = _record(
            SweepSettings(sweep_amplitude=AMPLITUDE, sweep_duration=size.sweep).excitation, Path(folder) / "sweep", rig
        )
    model = identify(used.data, 10, controller=used.controller).model
    measured = measured_sensitivity(swept.data, swept.controller)
    kept = measured.comparable()
    differences = compared(measured.difference_db(feedback_of(model, used.controller)), measured.frequency[kept])
    differences["coherence"] = float(measured.coherence[kept].min())
    results.keep("emulator", {"swept": {"emulator": differences}})
    print(json.dumps(differences))


def _record(excitation: Excitation, bag: Path, rig: GraphChoice) -> RecordedLoop:
    run_session([Experiment(excitation.kind, excitation)], bag, rig, lambda *_: None)
    loop = read(bag)
    assert loop.controller is not None
    print(f"{excitation.kind}: {len(loop.data.experiments)} pieces at {loop.data.sample_rate:g} Hz", file=sys.stderr)
    return loop


if __name__ == "__main__":
    main()
