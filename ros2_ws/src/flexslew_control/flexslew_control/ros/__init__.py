"""The controller and planner nodes. ROS is imported here.

Offers: controller_node.
"""
