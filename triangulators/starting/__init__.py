"""A valid triangulation to start from, put right where a library left something out."""
