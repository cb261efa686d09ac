"""Laws on the small motions of a platform whose appendages turn (Kwak 1989)."""
