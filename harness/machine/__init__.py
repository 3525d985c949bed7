"""The machine: what it is, what software runs on it, what its operating system does its own way."""
