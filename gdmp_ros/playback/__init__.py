"""Skills played tick by tick as references for an impedance controller. No ROS."""
