"""A rigid platform in space with any number of flexible appendages (Sung and Joo, Kwak 1989)."""
