"""Statistics of samples: intervals and ratios, and whether a run was disturbed."""
