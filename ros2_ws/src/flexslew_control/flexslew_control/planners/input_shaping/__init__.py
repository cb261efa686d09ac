"""Rigid commands shaped so that the appendages end at rest."""
