"""Goals, ways and turns of craft that turn in three axes."""
