"""The targets: every module in this folder is read."""
