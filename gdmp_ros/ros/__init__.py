"""ROS 2 nodes and their clients; the only room that imports rclpy."""
