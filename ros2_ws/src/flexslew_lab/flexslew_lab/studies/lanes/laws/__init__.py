"""What the laws of all lanes know of their benches, and the efforts that they ask for."""
