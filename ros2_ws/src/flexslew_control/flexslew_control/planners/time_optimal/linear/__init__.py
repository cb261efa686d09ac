"""The fastest slews of a linear model: where the search for the others begins."""
