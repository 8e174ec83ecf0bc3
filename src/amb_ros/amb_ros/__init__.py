"""amb_ros: the ROS wiring that all nodes share; every algorithm lives in amb_core."""
