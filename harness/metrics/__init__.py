"""Metrics of records: the registry, groups of comparable records, and the decision."""
