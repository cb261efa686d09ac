"""Which trials fly beside each other, who is in charge of each, and where their numbers stand."""
