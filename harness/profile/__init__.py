"""A device's cost model (law): costs of a triangle, a lane and a pixel, from a design of draws."""
