"""The raster slice of Skybox, an open GPU written in SystemVerilog, run by Verilator."""
