"""Controllers of other processes in lock-step with a plant: for replays, and to check them."""
