"""The optimum for H or for expected quads (Q) in compute shaders, for rings of up to 64 vertices.

The CPU does unsupported polygons (with holes, off the grid, or with more than 64 vertices), and
those that a failed device did not solve. Ties are broken as on the CPU.

H: the dynamic program of `optimum.full_table` in int32, with identical triangles.

Q: the dynamic program of `optimum.any_cost` in doubles. The shader has the kernel's operations in
the kernel's order, without fused ones, so the triangles are identical if the device rounds double
divisions correctly, as IEEE 754 does and GLSL does not require. In any case the CPU evaluates the
returned triangles, and their Q must be within 1e-9 of the device's sum, which is the minimum over
all triangulations up to the rounding of the device's sums.

OpenGL 4.3 through moderngl, which the project uses for drawing as well. GLSL has 64-bit products of
32-bit integers (imulExtended); WGSL, which would also run on macOS, does not.

    rings    conversion of polygons to integers, and of device results to checked triangles
    engine   opening of devices, the thread that owns them, and handling of failures
    shaders  the dynamic program of a ring (ring.glsl), with the costs of another file
"""
