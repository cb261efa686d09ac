"""The nodes of the lab. ROS is imported here.

Offers: conformance, console_node, live_node, operator, play_node.
"""
