"""Text of others for terminals, pages, logs and messages: what could control or break them is shown as an escape."""

from __future__ import annotations

import re

_CONTROLS = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # escape sequences begin with one of these
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # directions, which change the order of what is read
    "\u2028\u2029\ufeff\ud800-\udfff\U000e0000-\U000e007f]"
)
_NOT_FOR_ROS = re.compile("[\0\ud800-\udfff]")


def plain_text(text: object) -> str:
    r"""The text with control characters as their escapes, such as `\x1b`; line ends and tabs stay.

    All that a file, a topic or another node names passes here once, where it reaches a terminal, a page or a log.
    """
    return _CONTROLS.sub(lambda control: control[0].encode("unicode_escape").decode(), str(text))


def is_for_ros(text: str) -> bool:
    r"""Whether ROS carries the text whole: it cuts one at a NUL, and refuses a lone surrogate, which is no Unicode.

    YAML and JSON write the latter as an escape such as `\ud800`; Python gives it for a file name that is not UTF-8.
    """
    return _NOT_FOR_ROS.search(text) is None
