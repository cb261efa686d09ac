"""Laws that feed back joint by joint, and what they add in three axes."""
