"""A trial as it is flown, in this process or over ROS in several, with all that it leaves."""
