"""Independent checker of evidence of optimality.

The search for evidence and the checker share only definitions (boundary, orientation, cost, units).
The search imports the format of evidence and the units from here, never the other way round.
"""
