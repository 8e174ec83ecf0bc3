"""A graph as plain Python calls: `AmbClient`, and the parts that it is made of."""

from amb_bringup.client.amb_client import AmbClient
from amb_bringup.client.errors import ClientError
from amb_bringup.client.experiment import Experiment, ExperimentRun
from amb_bringup.client.loop_calls import RunEnd, StartedExcitation
from amb_core.ground.files.parameter_files import NODES

__all__ = ["NODES", "AmbClient", "ClientError", "Experiment", "ExperimentRun", "RunEnd", "StartedExcitation"]
