"""Files made to hurt their reader: they refer to other files, expand to gigabytes, nest deeply, or never end."""

from tests.fuzz import crafted_bags, crafted_tables  # noqa: F401  each adds its makers to the list
from tests.fuzz.crafted import CRAFTED, SECRET, make_secret

__all__ = ["CRAFTED", "SECRET", "make_secret"]
