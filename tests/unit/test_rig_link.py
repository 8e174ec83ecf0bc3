"""The link of the bridge that its parameters name."""

from __future__ import annotations

import pytest

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import validate
from amb_core.rig.link import AmbUdpLink
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.rig_link import require_host_loop


def test_in_mode_host_the_rotor_cannot_stay_up_without_the_bridge() -> None:
    stays = validate(BridgeParameters, {"mode": "host", "at_exit": "stay"})
    with pytest.raises(ParameterError, match="at_exit = 'stay' is not allowed with mode = 'host'"):
        require_host_loop(stays, AmbUdpLink())
    require_host_loop(validate(BridgeParameters, {"mode": "target", "at_exit": "stay"}), AmbUdpLink())
