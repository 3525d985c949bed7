"""Worker processes for code that may crash, hang, or need its own environment."""
