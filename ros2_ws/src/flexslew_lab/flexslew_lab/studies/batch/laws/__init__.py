"""What the laws of all members know of their benches, and the efforts that they ask for."""
