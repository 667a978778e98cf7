"""The 1 kHz loop, its statistics and the motion it plays. No ROS."""
