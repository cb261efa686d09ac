"""Names and rights on the graph of ROS, without loading ROS itself.

Offers: graph_names, policies, rtps, topics.
"""
