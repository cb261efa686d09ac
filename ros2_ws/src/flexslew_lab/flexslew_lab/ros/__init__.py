"""The nodes of the lab. ROS is imported here.

Offers: console_node, live_node, lock_step.conformance, lock_step.linked_program, operator,
play_node.
"""
