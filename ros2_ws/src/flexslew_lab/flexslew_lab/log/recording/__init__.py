"""Writing a log: what is written, in which order, whole up to its last chunk."""
