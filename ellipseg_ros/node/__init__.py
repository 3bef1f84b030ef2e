"""What a node needs and ROS does not provide: grouping, backlog, health, pacing, shutdown."""
