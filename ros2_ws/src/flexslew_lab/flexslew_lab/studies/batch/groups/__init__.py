"""Which trials fly side by side, which controller is active, and where the numbers are."""
