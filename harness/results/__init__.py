"""Records and run folders: their types, reading and writing."""
