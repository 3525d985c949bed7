"""Studies: does a criterion predict the measured cost, and what does a better choice gain?"""
