"""The console over a bench in its own process, without ROS."""
