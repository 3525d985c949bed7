"""Studies: does a criterion predict what was measured, and what does a better choice buy?"""
