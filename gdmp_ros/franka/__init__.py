"""A Franka robot over its network protocol, through libfranka. No ROS."""
