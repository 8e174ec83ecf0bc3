"""amb_sim_node: the simulated bearing as a ROS 2 node."""
