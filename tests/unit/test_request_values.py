"""Values reach a node as they are given, or are refused; neither rclpy nor the middleware checks them for users."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from amb_bringup.client import AmbClient
from amb_bringup.client.connection import checked_domain
from amb_bringup.client.errors import ClientError
from amb_bringup.client.messages import filled
from amb_msgs.action import BuildMap
from amb_msgs.msg import Machine, MachineAxis
from amb_msgs.srv import Certify, RunSteps, StartExcitation

EXCITATION = StartExcitation.Request


def sent(kind: Any, /, **fields: Any) -> Any:
    """What a node receives."""
    return deserialize_message(serialize_message(filled(kind, "/amb/node/service", fields)), kind)


@pytest.mark.parametrize(
    ("kind", "field", "value", "received"),
    [
        (Certify.Request, "extra_delay", 1, 1.0),
        (Certify.Request, "extra_delay", np.int64(2), 2.0),
        (Certify.Request, "extra_delay", np.float32(1.5), 1.5),
        (Certify.Request, "extra_delay", np.float64(1.5), 1.5),
        (Certify.Request, "extra_delay", np.array(1.5), 1.5),
        (BuildMap.Goal, "amplitude_high", 1, 1.0),
        (BuildMap.Goal, "initial_sweeps", np.uint8(7), 7),
        (EXCITATION, "seed", np.int64(3), 3),
        (EXCITATION, "first_step", np.int32(-1), -1),
        (EXCITATION, "odd", np.bool_(True), True),
        (EXCITATION, "odd", True, True),
        (EXCITATION, "axes", np.str_("x"), "x"),
        (EXCITATION, "frequencies", np.array([1, 2], np.float32), [1.0, 2.0]),
        (EXCITATION, "frequencies", (1, np.int64(2)), [1.0, 2.0]),
        (RunSteps.Request, "steps", 2**64 - 1, 2**64 - 1),
    ],
)
def test_a_number_of_python_or_numpy_arrives_as_it_is(kind: Any, field: str, value: Any, received: Any) -> None:
    answer = getattr(sent(kind, **{field: value}), field)
    assert (list(answer) if isinstance(received, list) else answer) == received


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [
        ("amplitude", "1um", "amplitude = '1um' is not allowed; allowed: a number"),
        ("amplitude", True, "amplitude = True is not allowed; allowed: a number"),
        ("amplitude", None, "amplitude = None is not allowed"),
        ("amplitude", 1j, "amplitude = 1j is not allowed"),
        ("amplitude", 10**400, "is not allowed; allowed: a number"),
        ("amplitude", np.array([1e-6]), "amplitude = array([1.e-06]) is not allowed"),
        ("amplitude", np.ma.masked, "amplitude = masked is not allowed"),
        ("duration", np.timedelta64(1, "ns"), "is not allowed; allowed: a number"),
        ("seed", 3.0, "seed = 3.0 is not allowed; allowed: a whole number from 0 to 4294967295"),
        ("seed", -1, "seed = -1 is not allowed; allowed: a whole number from 0 to 4294967295"),
        ("seed", 2**32, "seed = 4294967296 is not allowed"),
        ("seed", False, "seed = False is not allowed"),
        ("odd", 1, "odd = 1 is not allowed; allowed: True or False"),
        ("kind", None, "kind = None is not allowed; allowed: text"),
        ("axes", Path("x"), "is not allowed; allowed: text"),
        ("frequencies", 100.0, "frequencies = 100.0 is not allowed; allowed: a list, each a number"),
        ("frequencies", np.array(100.0), "is not allowed; allowed: a list, each a number"),
        ("frequencies", "100", "frequencies = '100' is not allowed; allowed: a list, each a number"),
        ("frequencies", [1.0, "2"], "frequencies = [1.0, '2'] is not allowed"),
        ("frequencies", np.ma.masked_equal([1.0, 2.0], 2.0), "is not allowed; allowed: a list, each a number"),
        ("amplitud", 1.0, "unknown field 'amplitud'; allowed: kind, axes"),
    ],
)
def test_a_value_of_another_type_is_refused_in_one_line(field: str, value: Any, problem: str) -> None:
    with pytest.raises(ClientError, match=f"^/amb/node/service: .*{re.escape(problem)}") as caught:
        sent(EXCITATION, **{field: value})
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 700


def test_nested_messages_arrive_as_they_are() -> None:
    axis = MachineAxis(name="x", direction=[1.0, 0.0, 0.0])
    assert sent(Machine, axes=[axis], sample_rate=10_000) == Machine(axes=[axis], sample_rate=10_000.0)
    assert sent(MachineAxis, direction=(1, 0, 0)) == MachineAxis(direction=[1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"domain_id": 233}, "domain_id = 233 is not allowed; allowed: 0 to 232"),
        ({"domain_id": -1}, "domain_id = -1 is not allowed; allowed: 0 to 232"),
        ({"domain_id": "3"}, "domain_id = '3' is not allowed; allowed: a whole number"),
        ({"timeout": "a"}, "timeout = 'a' is not allowed; allowed: a number"),
        ({"timeout": -1.0}, "timeout = -1.0 is not allowed; allowed: 0 s or more"),
        ({"timeout": math.nan}, "timeout = nan is not allowed; allowed: 0 s or more"),
        ({"namespace": "a b"}, "namespace = 'a b' is not allowed; allowed: letters, digits and _"),
        ({"namespace": None}, "namespace = None is not allowed"),
        ({"nodes": [1]}, "nodes = [1] is not allowed; allowed: a text for each"),
    ],
)
def test_a_client_that_cannot_be_is_refused_in_one_line(arguments: dict[str, Any], problem: str) -> None:
    with pytest.raises(ClientError, match=f"^{re.escape(problem)}"):
        AmbClient(**arguments)


@pytest.mark.parametrize("domain", ["240", "-1", "abc", "1e2", "4294967296"])
def test_a_domain_of_the_environment_that_ends_the_process_is_refused(
    domain: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(ClientError, match=f"^ROS_DOMAIN_ID = '{domain}' is not allowed; allowed: 0 to 232$"):
        AmbClient()
    assert checked_domain(232) == 232  # which counts then
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert checked_domain(None) is None
