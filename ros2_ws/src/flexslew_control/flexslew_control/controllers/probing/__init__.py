"""A controller at rest, asked what it answers to what it may read."""
