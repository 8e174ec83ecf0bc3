"""What calls of a graph raise."""

from amb_core.ground.errors import AmbError


class ClientError(AmbError):
    """A node of the graph is missing, does not answer in time, or refuses a request."""


class NoAnswerError(ClientError):
    """A request was sent, and is not answered in time: nobody knows whether it was carried out."""


class RefusalError(ClientError):
    """A transition was asked for that the present state of its node does not allow."""


class EndError(ClientError):
    """The end of a session has failed: the rotor may be up, or the recording open; the text says which."""
