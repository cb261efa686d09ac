"""Many trials at once by one compiled kernel, checked by the ordinary bench."""
