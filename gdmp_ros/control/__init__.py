"""Control: pure functions and small state machines, without ROS and without a simulator."""
