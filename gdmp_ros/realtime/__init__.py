"""The 1 kHz loop and its statistics. No ROS."""
