"""Why nothing is cheaper: exclusions, a table of what is left, potentials by a linear program."""
