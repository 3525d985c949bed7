"""Independent checker of evidence of optimality.

The search for evidence and the checker share only definitions: a polygon's boundary, the sign of an
orientation, the cost of a triangle and the units. The search imports the format of evidence and the
rule for units from this package, which never imports the search.
"""
