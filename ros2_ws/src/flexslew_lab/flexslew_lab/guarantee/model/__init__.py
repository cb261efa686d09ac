"""A trial's plant and loop with uncertain parameters, at single values and over a box."""
