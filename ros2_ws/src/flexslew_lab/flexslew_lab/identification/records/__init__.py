"""Records of experiments: efforts and readings on ticks, from logs and from files of others."""
