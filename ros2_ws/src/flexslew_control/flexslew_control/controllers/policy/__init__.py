"""A law that a network gives, and what the network observes of the bench at a tick."""
