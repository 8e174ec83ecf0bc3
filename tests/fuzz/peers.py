"""A stranger's node in the DDS domain of a rig that levitates: what it tries, and what it brings about.

An attack succeeds if it is not refused, or if the rotor is worse off afterwards: a trip, another run, off, a touch. To
land the rotor is anybody's right on a topic without access control (SECURITY.md), so it is none of the attacks.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from amb_core.excitation import Square
from amb_core.recording.messages.excitation import fill_excitation
from amb_msgs.msg import Excitation
from amb_ros.qos import LATCHED
from tests.graph.conftest import opened_graph
from tests.graph.rig import Rig

GENERATOR, MONITOR = "amb_controller_node.excitation_generator", "amb_ident_node.region_monitor"
STEPS = 500  # that the loop goes on after each attack
PARAMETERS: tuple[dict[str, Any], ...] = (
    {"protection__trip_share": 1.0},
    {"protection__alarm_share": 1.0},
    {"protection__alarm_share": 1.0, "protection__trip_share": 1.0},
    {"proportional_gain": 0.0},
    {"derivative_gain": 0.0},
    {"proportional_gain": 0.0, "derivative_gain": 0.0},
    {"proportional_gains": [0.0, 0.0]},
    {"derivative_gains": [0.0, 0.0]},
    {"proportional_gain": 1e9},
    {"proportional_gain": -1.0},
    {"current_limit": 0.0},
    {"current_limit": 1e9},
    {"nominal_reference": [2e-4, 0.0]},
    {"at_exit": "leave"},
    {"network": "allow"},
    {"allowed.proportional_gain": [0.0, 1e9]},
    {"link.host": "203.0.113.1"},
)
TRANSITIONS = ("configure", "activate", "cleanup")


def attack(quick: bool = False) -> dict[str, Any]:
    """Attack a rig; the number of attacks, and those that succeeded, by name."""
    with tempfile.TemporaryDirectory() as folder, opened_graph(Path(folder)) as graph:
        rig = Rig(graph)
        graph.start(GENERATOR)
        graph.start(MONITOR)
        run = rig.levitate()
        attacks = _attacks(rig, run)
        chosen = dict(list(attacks.items())[::5]) if quick else attacks
        succeeded = [name for name, carried_out in chosen.items() if carried_out() or _is_worse_off(rig, run)]
        return {"attacks": len(chosen), "succeeded": len(succeeded), "names": succeeded}


def _is_worse_off(rig: Rig, run: int) -> bool:
    """Whether the rotor is not levitated as before, or moves beyond the alarm, over the next steps."""
    rig.wait_for_step(rig.state.step + STEPS)
    return bool(rig.trips) or rig.state.run != run or rig.state.mode != rig.state.LEVITATED


def _attacks(rig: Rig, run: int) -> dict[str, Callable[[], bool]]:
    """What a stranger can ask for; each says whether it was done."""
    attacks: dict[str, Callable[[], bool]] = {
        f"set {values}": lambda values=values: not rig.refusals("hardware_bridge", **values) for values in PARAMETERS
    }
    attacks |= {label: lambda label=label: rig.change(label) for label in TRANSITIONS}
    attacks["start 100 um"] = lambda: bool(rig.excite(Square(amplitude=100e-6, duration=0.1)).success)
    attacks["publish 100 um"] = lambda: _publish(rig, run)
    attacks["scheduler of dask"] = lambda: _sets(rig, "region_monitor", "scheduler", "tcp://127.0.0.1:1")
    return attacks


def _publish(rig: Rig, run: int) -> bool:
    """Publish an excitation past the generator; a protection that trips because of it shows in the state."""
    node = rig.graph.node
    publisher = node.create_publisher(Excitation, "/amb/excitation", LATCHED)
    rig.graph.wait_until(publisher.get_subscription_count, "the bridge")
    square = Square(amplitude=100e-6, duration=0.1, axes="all")
    publisher.publish(fill_excitation(Excitation(id=1), square, run, Excitation.FROM_NEXT_STEP, 10_000.0))
    rig.wait_for_step(rig.state.step + STEPS)
    node.destroy_publisher(publisher)
    return False


def _sets(rig: Rig, node: str, name: str, value: object) -> bool:
    parameter = Parameter(name, value=value).to_parameter_msg()
    (result,) = rig.graph.call(SetParameters, f"/amb/{node}/set_parameters", parameters=[parameter]).results
    return bool(result.successful)
