"""Readers of files, one module per format; `reader` chooses by suffix."""
