"""The optimum for the half-perimeter in compute shaders, for many rings of up to 64 corners.

The recurrence is that of `optimum.full_table` in int32, and the results are those of the CPU,
triangle for triangle: ties are broken alike. What a device does not do (polygons with holes, off
the grid, of more than 64 vertices), and what one that fails leaves undone, is left to the CPU.

OpenGL 4.3 through moderngl, which the project needs anyway. GLSL has the product of two 32-bit
integers in 64 bits (imulExtended); WGSL, which would reach macOS too, has not.

    rings    polygons into integers for a device, and what it found into triangles, checked
    engine   opening a device, the thread that owns it, and what is done where it fails
"""
