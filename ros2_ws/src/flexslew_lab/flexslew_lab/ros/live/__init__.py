"""The parts of the `live` node: topics, services and parameters of the bench for Foxglove."""
