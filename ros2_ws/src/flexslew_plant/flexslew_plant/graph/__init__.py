"""What stands on the graph of ROS, and who can reach it; it loads no ROS itself.

Offers: graph_names, policies, rtps, topics.
"""
