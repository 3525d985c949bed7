"""Every figure there is, by name, and what can be computed with them."""
