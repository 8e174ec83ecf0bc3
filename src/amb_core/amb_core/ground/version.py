"""Version of the library, and of all packages of the workbench."""

__version__ = "0.2.0"
