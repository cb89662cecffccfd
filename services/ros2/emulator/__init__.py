"""An emulated Cartesian controller of ROS 2, which moves the peg of a simulator and has a wrist that feels."""
