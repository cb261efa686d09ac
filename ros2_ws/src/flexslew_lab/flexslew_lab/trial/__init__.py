"""Trials: the file, its flight in process or over ROS 2, its processes."""
