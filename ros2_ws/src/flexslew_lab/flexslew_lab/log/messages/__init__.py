"""Messages and records as bytes and text, without ROS, checked when they are read."""
