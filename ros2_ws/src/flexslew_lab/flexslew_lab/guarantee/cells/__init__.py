"""Certificates by cells of the box, each with a bound in modal coordinates at its centre."""
