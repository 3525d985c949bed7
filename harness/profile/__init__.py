"""A device's law: the costs of a triangle, a lane and a pixel, from a design of draws.

placing     a draw; triangles with integer coordinates, from a seed, without overlaps
design      the draws; each kind isolates one or two terms
stage_draws draws that separate the stages of a GPU
counted     exact counters of each draw, by the CPU reference
fitting     robust least squares: non-negative costs, relative errors
law         sum or maximum of stages: seconds for each term, intervals, explained variance
measured    the times of the design on a device
advice      aspect ratio from which thin triangles are slow; recommended criterion
profile     the file format
report      the law as sentences, as a table and as a chart
"""
