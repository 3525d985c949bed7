"""The optimum for the half-perimeter in compute shaders, for many rings of up to 64 vertices.

The dynamic program is that of `optimum.full_table` in int32, with identical triangles, because ties
are broken in the same way. The CPU does unsupported polygons (with holes, off the grid, or with
more than 64 vertices), and those that a failed device did not solve.

OpenGL 4.3 through moderngl, which the project uses for drawing as well. GLSL has 64-bit products of
32-bit integers (imulExtended); WGSL, which would also run on macOS, does not.

    rings    conversion of polygons to integers, and of device results to checked triangles
    engine   opening of devices, the thread that owns them, and handling of failures
"""
