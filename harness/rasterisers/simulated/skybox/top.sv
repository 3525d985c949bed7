// The raster slice of Skybox with what a testbench needs round it, and nothing that changes it.
//
// The slice takes one triangle in one tile at a time: where the tile lies, the three edge functions
//
//     e(x, y) = a x + b y + c,   x, y in pixels from the tile's lower left pixel, e >= 0 inside,
//
// and, for each edge, its extent: how much e grows, at most, from that pixel to any point of the
// tile. That is the sum of what is positive of a*size and b*size, and the slice's own module works
// it out. A square of size s at (x, y) may meet the triangle only if e(x, y) + extent >= 0 for
// all three edges. So the slice tests the tile, then its four quarters, down to a block, whose
// 2x2 quads it tests pixel by pixel.
//
// It hands over a beat: up to OUTPUT_QUADS quads of one block, each with a mask of its pixels; a
// quad of a beat may have none. Both sides are handshakes: something passes at a rising clock edge
// when its `valid` and its `ready` are both set, and only then.
//
// Taps, which only look: `node` is set in each cycle in which the tile evaluator tests a square
// and is not held up; `block` when a block is handed on. A stalled evaluator keeps its square, so
// without that condition a square would be counted once for every cycle it waits.

`include "VX_raster_define.vh"

module top import VX_raster_pkg::*; #(
    parameter TILE_LOGSIZE  = 5,
    parameter BLOCK_LOGSIZE = 2,
    parameter OUTPUT_QUADS  = 4
) (
    input  wire                               clk,
    input  wire                               reset,

    // a triangle in a tile; edges[k] = {c, b, a} of edge k, c at the tile's lower left pixel
    input  wire                               in_valid,
    output wire                               in_ready,
    input  wire [`VX_RASTER_DIM_BITS-1:0]     in_x,
    input  wire [`VX_RASTER_DIM_BITS-1:0]     in_y,
    input  wire [`VX_RASTER_PID_BITS-1:0]     in_pid,
    input  wire [2:0][2:0][`RASTER_DATA_BITS-1:0] in_edges,

    // pixels outside are not covered: x_min <= x < x_end, y_min <= y < y_end
    input  wire [`VX_RASTER_DIM_BITS-1:0]     x_min,
    input  wire [`VX_RASTER_DIM_BITS-1:0]     x_end,
    input  wire [`VX_RASTER_DIM_BITS-1:0]     y_min,
    input  wire [`VX_RASTER_DIM_BITS-1:0]     y_end,

    // a beat of quads: {y / 2, x / 2, mask}, bit 2 j + i of the mask for the pixel at (x + i, y + j)
    output wire                               out_valid,
    input  wire                               out_ready,
    output wire [31:0]                        out_quads [OUTPUT_QUADS-1:0],
    output wire [`VX_RASTER_PID_BITS-1:0]     out_pids  [OUTPUT_QUADS-1:0],

    output wire                               busy,
    output wire                               node,
    output wire                               block,
    output wire [`VX_RASTER_PID_BITS-1:0]     node_pid
);
    wire [2:0][`RASTER_DATA_BITS-1:0] extents;
    raster_stamp_t [OUTPUT_QUADS-1:0] stamps;
    raster_dcrs_t no_settings;  // the slice passes them on and uses none

    assign no_settings = '0;

    VX_raster_extents #(
        .TILE_LOGSIZE (TILE_LOGSIZE)
    ) tile_extents (
        .edges   (in_edges),
        .extents (extents)
    );

    VX_raster_slice #(
        .INSTANCE_ID   ("slice"),
        .TILE_LOGSIZE  (TILE_LOGSIZE),
        .BLOCK_LOGSIZE (BLOCK_LOGSIZE),
        .OUTPUT_QUADS  (OUTPUT_QUADS)
    ) slice (
        .clk        (clk),
        .reset      (reset),
        .dcrs       (no_settings),
        .valid_in   (in_valid),
        .xloc_in    (in_x),
        .yloc_in    (in_y),
        .xmin_in    (x_min),
        .xmax_in    (x_end),
        .ymin_in    (y_min),
        .ymax_in    (y_end),
        .pid_in     (in_pid),
        .edges_in   (in_edges),
        .extents_in (extents),
        .ready_in   (in_ready),
        .valid_out  (out_valid),
        .stamps_out (stamps),
        .busy_out   (busy),
        .ready_out  (out_ready)
    );

    for (genvar q = 0; q < OUTPUT_QUADS; ++q) begin
        assign out_quads[q] = {stamps[q].pos_y, stamps[q].pos_x, stamps[q].mask};
        assign out_pids[q]  = stamps[q].pid;
    end

    assign node     = slice.tile_evaluator.tile_valid && ~slice.tile_evaluator.stall;
    assign block    = slice.block_valid && slice.block_ready;
    assign node_pid = slice.tile_evaluator.tile_pid;
endmodule
