"""ROS 1 nodes: move_base's interface around the goal manager, the simulated robot, and the tools around them.

rospy and the messages come from Debian's packages (`tools/install_ros1.sh`); they are imported only in this package.
"""
