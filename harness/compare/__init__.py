"""Compares two runs and says what changed: for a person, for a machine, and as a CI gate."""
