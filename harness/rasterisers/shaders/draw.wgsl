// Draw for timing: one colour, and `work` rounds of arithmetic that compilers cannot remove.
//
// The frame's y is the framebuffer's y, so rows, quads and the fill rule are the same; the sign
// changes because WebGPU's clip space has y up and the framebuffer y down.

struct View {
    size: vec2<f32>,  // of the viewport, in 1/256 px
    work: u32,
}

@group(0) @binding(0) var<uniform> view: View;

struct Covered {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) colour: vec4<f32>,
}

@vertex
fn place(@location(0) point: vec2<i32>, @location(1) polygon: u32) -> Covered {
    let unit = 2.0 * vec2<f32>(point) / view.size - 1.0;
    let mixed = (((polygon + 1u) * 2654435761u) >> 8u) | 0xFF404040u;
    return Covered(vec4<f32>(unit.x, -unit.y, 0.0, 1.0), unpack4x8unorm(mixed));
}

@fragment
fn shade(pixel: Covered) -> @location(0) vec4<f32> {
    var value = pixel.position.x;
    for (var i = 0u; i < view.work; i++) {
        value = fract(value * 1.618034 + 0.1);
    }
    // Too small to show in 8 bits.
    return pixel.colour + vec4<f32>(select(0.0, value * 1e-7, view.work > 0u));
}
