"""What calls of a graph raise."""

from amb_core.ground.errors import AmbError


class ClientError(AmbError):
    """A node of the graph is missing, does not answer in time, or refuses a request."""


class NoAnswerError(ClientError):
    """A request was sent, and is not answered in time: nobody knows whether it was carried out."""
