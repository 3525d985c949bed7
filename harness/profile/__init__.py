"""A device's law: what a triangle, a lane and a pixel cost on it, from one design of draws.

placing     triangles in whole numbers, made from a seed, none over another
design      the draws, each kind of which isolates a term or two
counted     what each draw costs exactly, by the CPU reference
law         the fit: seconds for each term, intervals, what it explains
measured    the design timed on a device, and what is made of it
advice      from which aspect on thin triangles are slow; which criterion to triangulate by
sizes       at which sizes of a file the choice matters, counted, in ms by a law
profile     the file, and what is read of it
words       the law in plain sentences, its table, and its chart
"""
