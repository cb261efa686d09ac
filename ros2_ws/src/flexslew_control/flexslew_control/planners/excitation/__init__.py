"""Plans that shake a bench to identify it."""
