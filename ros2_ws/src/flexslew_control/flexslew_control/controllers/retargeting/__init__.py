"""Laws on the small motions of a platform with appendages that turn (Kwak 1989)."""
