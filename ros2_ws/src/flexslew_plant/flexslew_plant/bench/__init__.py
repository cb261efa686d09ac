"""The bench without ROS: the tick, its drive, motors, sensors, schedule and records."""
