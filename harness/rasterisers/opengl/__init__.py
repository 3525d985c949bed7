"""OpenGL: contexts, devices through EGL and OSMesa, counting by atomics, compute shaders."""
