"""Our triangulators, one algorithm per module; `libraries` has the others."""
