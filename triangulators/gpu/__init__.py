"""The optimum of half-perimeter (H) or expected quads (Q) by compute shaders, for small rings.

The CPU solves unsupported polygons, and polygons that a failed device did not solve. Ties are
broken as on the CPU.

H: the dynamic program of `optimum.full_table` in int32. The triangles are identical to the CPU's.

Q: the dynamic program of `optimum.any_cost` in doubles, with the operations of the CPU's kernel in
the same order, without fused operations. So the triangles are identical if the device rounds double
divisions correctly, as IEEE 754 requires and GLSL does not. On any device, Q of the returned
triangles, computed by the CPU, must be within 1e-9 of the device's sum.

The shaders run in OpenGL 4.3. GLSL has 64-bit products of 32-bit integers (imulExtended); WGSL,
which would also run on macOS, has not.
"""
