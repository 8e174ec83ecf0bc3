"""amb_ident_node: recorder of bags, monitor of regions and identification of state-space models as ROS 2 nodes."""
