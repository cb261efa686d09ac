"""Metrics of a platform: its motion, how it and its appendages point, and where they may not."""
