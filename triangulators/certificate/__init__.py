"""Proof of optimality: edge exclusion (LMT), a dynamic program, dual potentials of an LP."""
