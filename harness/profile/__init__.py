"""A device's law: what a triangle, a lane and a pixel cost on it, from one design of draws.

placing     triangles in whole numbers, made from a seed, none over another
design      the draws, each kind of which isolates a term or two
counted     what each draw costs exactly, by the CPU reference
law         the fit: seconds for each term, intervals, what it explains, the fewest terms
measured    the design timed on a device, and what is made of it
advice      which criterion to triangulate by on the device, and what it saves
sizes       at which sizes of a file the choice matters, counted, in ms by a law
profile     the file, and what is read of it
words       the law in plain sentences, and its table
chart       time against aspect at equal area
"""
