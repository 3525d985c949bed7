"""WebGPU through wgpu: adapters, passes, drawing."""
