"""A rigid platform in space with any number of flexible appendages (papers/002, papers/004)."""
