"""The fastest turns in three axes, about cones and within limits of the way."""
