"""From the sections of a trial file to a spacecraft in SI, checked and packed."""
