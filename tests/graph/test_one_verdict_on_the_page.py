"""The live page, the service and the library give one verdict on the same model and data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from amb_bringup.view.orders import Orders
from amb_core.identification import IdentificationData, identify, validate
from amb_core.loop.control import ControllerParameters
from tests.graph.identifier_loop import FIRST_STEP, STEPS, Loop, linear_loop

if TYPE_CHECKING:
    from tests.graph.conftest import Graph


@pytest.mark.parametrize(("order", "refused"), [(4, False), (2, True)], ids=["right order", "too low an order"])
def test_the_live_page_shows_the_verdict_of_service_and_library(
    graph: Graph, monkeypatch: pytest.MonkeyPatch, order: int, refused: bool
) -> None:
    loop, record = Loop(graph, parameter_timeout=10.0), linear_loop(STEPS)
    graph.start("amb_controller_node.pd_controller")
    run = loop.publish(record)
    monkeypatch.setenv("ROS_DOMAIN_ID", graph.environment["ROS_DOMAIN_ID"])
    orders = Orders(lambda: run)
    try:
        shown = orders.lane("identify").submit(orders.carry_out, "identify", {"order": order}, lambda text: None)
        on_page = shown.result()
    finally:
        orders.close()
    by_service = loop.validate()
    data = IdentificationData.from_record(record.window(FIRST_STEP, STEPS - FIRST_STEP))
    model = identify(data, order, controller=ControllerParameters())
    by_library = validate(model, data, ControllerParameters()).verdict
    assert (by_library == "not validated") is refused
    assert by_service.verdict == by_library.code, by_service.report
    assert on_page.startswith(f"{by_library} on the data of the estimate: "), on_page
