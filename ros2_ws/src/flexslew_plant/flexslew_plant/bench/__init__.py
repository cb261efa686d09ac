"""The bench without ROS: the tick with its hardware, its operation, schedule and records.

Offers: bench, divergence, due_ticks, handover, injections, message_fields, operation.presence,
operation.requests, operation.run_state, operation.session, records, retarget, schedule, wire.
"""
