"""The optimum of half-perimeter (H) or expected quads (Q) by compute shaders, for small rings.

The CPU solves unsupported polygons (with holes, off the grid, or with more than 64 vertices), and
polygons that a failed device did not solve. Ties are broken as on the CPU.

H: the dynamic program of `optimum.full_table` in int32. The triangles are identical to the CPU's.

Q: the dynamic program of `optimum.any_cost` in doubles. The shader has the operations of the CPU's
kernel in the same order, without fused operations. So the triangles are identical if the device
rounds double divisions correctly, as IEEE 754 requires and GLSL does not. On any device, the CPU
computes Q of the returned triangles, which must be within 1e-9 of the device's sum: that sum is the
minimum over all triangulations, up to rounding on the device.

The shaders run in OpenGL 4.3 through moderngl. GLSL has 64-bit products of 32-bit integers
(imulExtended); WGSL, which would also run on macOS, has not.

    rings    conversion of polygons to integers, and of device results to checked triangles
    engine   opening of devices, the thread that owns them, and handling of failures
    shaders  the dynamic program of a ring (ring.glsl), with the costs of another file
"""
