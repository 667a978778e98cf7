"""ROS 2 nodes and their clients; the only package that imports rclpy."""
