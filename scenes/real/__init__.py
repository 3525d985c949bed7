"""Scenes of real shapes that packages carry: footprints, counties, letters."""
