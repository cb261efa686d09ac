"""The plant node and what every node of the bench shares. ROS is imported here.

Offers: alive, coroutines, dead_nodes, event_log, graph, loop, messages, node_process, offers,
outlets, parameters, plant.settings, plant_node, realtime, start, statuses.
"""
