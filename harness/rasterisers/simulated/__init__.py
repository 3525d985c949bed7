"""GPUs' rasterisers whose design is published, simulated cycle by cycle: their time is a count."""
