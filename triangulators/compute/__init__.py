"""What compiled code rests on: kernels, where they are kept, operations; it knows no polygon."""
