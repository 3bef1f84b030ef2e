"""The nodes: the only place for rclpy and generated messages."""
