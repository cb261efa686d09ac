"""The parts of the page, each a class with `refresh`."""
