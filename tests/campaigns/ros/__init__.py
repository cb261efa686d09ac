"""Campaigns over ROS 2: each case flies nodes of its own."""
