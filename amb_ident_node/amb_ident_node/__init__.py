"""amb_ident_node: recorder of bags and identification of state-space models as ROS 2 nodes."""
