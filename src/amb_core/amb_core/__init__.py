"""amb_core: active magnetic bearings without ROS — plant, control law, excitations, identification and bags."""

__version__ = "0.1.0"
