"""The ROS 2 processes: the only package that imports rclpy and the messages."""
