"""Worker processes for code that may crash, hang, or require a separate environment."""
