"""A benchmark that cannot be measured here, with the reason."""


class Skipped(Exception):  # noqa: N818  # no error
    """Why a benchmark is left out."""
