"""Exact predicates, visibility, half-edges, flips and triangle order."""
