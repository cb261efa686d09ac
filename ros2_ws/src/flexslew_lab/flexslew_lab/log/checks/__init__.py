"""What may be wrong with a log: damage, gaps, time, definitions, its beginning and its end."""
