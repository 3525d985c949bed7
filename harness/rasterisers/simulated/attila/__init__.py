"""The design `attila`: a whole desktop GPU of 2006, modelled by its authors cycle by cycle."""
