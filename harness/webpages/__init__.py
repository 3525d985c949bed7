"""What HTML pages are made with: templates, and one file with everything in it."""
