"""Execution of a plan: worker processes, counting, timing, records."""
