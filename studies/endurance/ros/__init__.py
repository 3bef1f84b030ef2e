"""ROS nodes that the endurance tests run beside the segmenter."""
