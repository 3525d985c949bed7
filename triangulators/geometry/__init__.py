"""Exact predicates on coordinates, who sees whom, neighbours and order of triangles."""
