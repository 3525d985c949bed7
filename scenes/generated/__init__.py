"""Scenes made from a seed: a city, sheet metal parts, shapes that break triangulators."""
