"""The sampled control loop: the control law, its records and telemetry, and the experiments in a run."""
