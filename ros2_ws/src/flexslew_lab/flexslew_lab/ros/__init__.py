"""The nodes of the lab. ROS is imported here."""
