"""Checks evidence of optimality: definitions are all it shares with the search that found it."""
