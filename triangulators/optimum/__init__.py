"""Dynamic programs for the optimum of a ring and of rings with holes; local search."""
