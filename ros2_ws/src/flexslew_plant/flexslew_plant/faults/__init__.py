"""What can break on the bench, and the injection of it."""
