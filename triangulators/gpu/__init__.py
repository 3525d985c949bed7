"""The optimum for the half-perimeter in compute shaders: for many rings at once, or large ones.

The recurrence is that of `edge_table` in int32 (see there why no sum overflows), and the results
are those of the CPU, triangle for triangle: ties are broken alike. What a device does not do
(polygons with holes, off the grid, of more than 2,048 vertices, with sums beyond int32), and what
one that fails leaves undone, is left to the CPU.

OpenGL 4.3 through moderngl, which the project needs anyway. GLSL has the product of two 32-bit
integers in 64 bits (imulExtended); WGSL, which would reach macOS too, has not.

    device_context   opening a device
    rings            polygons into integers, for a device
    small            rings of up to 64 corners: a workgroup each, the table in shared memory
    large            rings of up to 2,048: tiles of a table in a buffer
    found_triangles  what a device found into triangles, checked
    engine           the thread that owns a device, and what is done where it fails
    known_devices    which device was measured to be faster than the CPU
"""
