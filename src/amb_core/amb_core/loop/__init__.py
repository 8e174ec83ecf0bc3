"""The control loop as it is sampled: the control law, its records and telemetry, and the experiments in a run."""
