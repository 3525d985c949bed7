"""Metrics of records: registry, groups of comparable records, statistics, and the decision."""
