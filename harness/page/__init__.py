"""Pages that draw and measure a run's triangulations, or a profile's draws, in a browser."""
