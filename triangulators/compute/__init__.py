"""What compiled code rests on: kernels, copies, SIMD, threads, union-find; it knows no polygon."""
