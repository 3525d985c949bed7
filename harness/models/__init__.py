"""3D models: what is flat in them is triangulated again in place, and nothing else changes."""
