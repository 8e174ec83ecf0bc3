"""amb_controller_node: position controller and excitation generator as ROS 2 nodes."""
