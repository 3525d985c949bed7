"""The report of a run or a study: one HTML file that needs nothing else, not even a network."""
