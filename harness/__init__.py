"""Measures what a triangulation costs to rasterise, and how well each criterion predicts it."""

__version__ = "1.0.0"
