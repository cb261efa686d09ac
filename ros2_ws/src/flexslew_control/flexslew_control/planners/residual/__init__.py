"""The residual of a plan: on the planner's model, on the whole bench, from a known motion."""
