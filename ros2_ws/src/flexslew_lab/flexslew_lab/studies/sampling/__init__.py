"""Where a study flies: how values are spread, and which points of that are taken."""
