"""3D models: new diagonals for flat faces, without any other change to the file."""
