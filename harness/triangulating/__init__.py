"""From names of triangulators to checked triangles of a frame."""
