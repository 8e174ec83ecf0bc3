"""Parameters of the node `region_monitor`."""

from __future__ import annotations

from amb_core.ground.parameters import choice, quantity
from amb_core.regions import RegionParameters


class RegionMonitorParameters(RegionParameters):
    """Parameters of the node: those of the classifier, and of its interface to the graph."""

    publish_period: float = quantity(0.05, "s", "run time between messages on region while nothing changes", 0.002, 0.1)
    simulator: str = choice("simulator", "node whose parameters describe the plant of a map, relative or full name")
    controller: str = choice(
        "pd_controller", "node whose parameters describe the controller of a map, relative or full name"
    )
    machine_timeout: float = quantity(
        5.0,
        "s",
        "longest wait for the machine once telemetry of its axes arrives; without it bearings follow from the names "
        "of the axes, and D is not judged unless `backup_bearing_radius` is given",
        0.0,
        60.0,
    )
    parameter_timeout: float = quantity(1.0, "s", "longest wait for the parameters of either", 0.05, 10.0)
    scheduler: str = choice(
        "",
        "address of the dask scheduler that runs the sweeps of a map, tls://host:port; empty: this machine",
    )
