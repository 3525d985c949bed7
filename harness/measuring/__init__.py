"""Carries out a plan: processes, counts, times, records."""
