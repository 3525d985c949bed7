"""What compiled code rests on: SIMD, threads, union-find. Nothing here knows a polygon."""
