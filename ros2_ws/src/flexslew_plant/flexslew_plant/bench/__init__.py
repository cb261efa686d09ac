"""The bench without ROS: the tick with its hardware, its operation, schedule and records."""
