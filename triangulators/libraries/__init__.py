"""Triangulations as other libraries make them: ear clipping, Delaunay, sweep, manifold."""
