"""ROS 2 nodes: Nav2's interface around the goal manager, and the simulated robot."""
