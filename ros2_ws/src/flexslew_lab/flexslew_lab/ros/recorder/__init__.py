"""The parts of the `recorder` node: its parameters, and the messages that it receives."""
