"""Checks evidence of optimality, by code of its own.

What the search for evidence and this share are definitions: a polygon's boundary, the sign of an
orientation, what a triangle costs and in which units it is counted. The search imports the form of
evidence and the rule for units from here; nothing is imported from there.
"""
