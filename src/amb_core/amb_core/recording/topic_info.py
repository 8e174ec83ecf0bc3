"""A topic of a bag, as lists of topics show it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag and the number of its messages.

    Attributes
    ----------
    name : str
        Full name.
    type : str
        Type of its messages, as `package/msg/Name`.
    messages : int
        Number of its messages.
    """

    name: str
    type: str
    messages: int
