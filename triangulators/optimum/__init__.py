"""The least of a criterion by tables: over one ring, rings with holes, many rings at once."""
