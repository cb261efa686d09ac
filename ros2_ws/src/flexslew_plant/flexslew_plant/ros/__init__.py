"""The plant node and what every node of the bench shares. ROS is imported here."""
