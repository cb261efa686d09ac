"""What a bench is made of, from its log alone."""
