// Count fragments, quads, complete quads and covering triangles of each polygon if shaders cannot
// detect helper lanes.
//
// Each covered pixel computes the number k of pixels of its 2x2 quad that the triangle covers, and
// adds 12 / k to the polygon's counter. The k pixels of a quad together add 12, so the counter is
// exactly 12 times the number of quads. If k is 4, the quad is complete, and its four pixels add 4
// to another counter. An instance is a triangle; the pixel that sets its bit counts the triangle.

@group(0) @binding(0) var<uniform> size: vec2<f32>;  // of the viewport, in 1/256 px
// fragments, 12 times the quads, 4 times the complete quads, covering triangles of polygon 0, ...
@group(0) @binding(1) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read_write> covering: array<atomic<u32>>;  // a bit per triangle

struct Covered {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) ab: vec4<i32>,
    @location(1) @interpolate(flat) c: vec2<i32>,
    @location(2) @interpolate(flat) polygon: u32,
    @location(3) @interpolate(flat) triangle: u32,
}

@vertex
fn place(
    @builtin(vertex_index) corner: u32,
    @builtin(instance_index) triangle: u32,
    @location(0) ab: vec4<i32>,
    @location(1) c: vec2<i32>,
    @location(2) polygon: u32,
) -> Covered {
    let point = select(select(ab.xy, ab.zw, corner == 1u), c, corner == 2u);
    let unit = 2.0 * vec2<f32>(point) / size - 1.0;
    return Covered(vec4<f32>(unit.x, -unit.y, 0.0, 1.0), ab, c, polygon, triangle);
}

// The sign of twice the area of the triangle a, b, p: 1 if it is counter-clockwise, 0 if flat.
//
// Coordinates are below 2^22 (16,384 px of 256), so products need 44 bits and WGSL has 32. With
// v = 4096 * high + low the area is 2^24 * outer + 2^12 * middle + inner, where |outer| <= 2^21,
// |middle| <= 2^24 and |inner| <= 2^24; after carrying, inner and middle are in 0..4095, so that the
// sign is that of outer, or 1 if outer is 0 and inner or middle is not.
fn side(a: vec2<i32>, b: vec2<i32>, p: vec2<i32>) -> i32 {
    let d = b - a;
    let e = p - a;
    let dh = d >> vec2<u32>(12u);
    let dl = d & vec2<i32>(4095);
    let eh = e >> vec2<u32>(12u);
    let el = e & vec2<i32>(4095);
    var outer = dh.x * eh.y - dh.y * eh.x;
    var middle = dh.x * el.y + dl.x * eh.y - dh.y * el.x - dl.y * eh.x;
    var inner = dl.x * el.y - dl.y * el.x;
    middle += inner >> 12u;
    inner &= 4095;
    outer += middle >> 12u;
    middle &= 4095;
    if (outer != 0) {
        return select(1, -1, outer < 0);
    }
    return select(0, 1, (middle | inner) != 0);
}

// Whether a point is inside the edge from a to b with the triangle on the left; a point on the edge
// is inside only if the edge runs down, or is horizontal and runs right.
fn passes(a: vec2<i32>, b: vec2<i32>, p: vec2<i32>) -> bool {
    let d = b - a;
    let closed = d.y < 0 || (d.y == 0 && d.x > 0);
    return side(a, b, p) >= select(1, 0, closed);
}

@fragment
fn count(pixel: Covered) -> @location(0) vec4<f32> {
    let a = pixel.ab.xy;
    var b = pixel.ab.zw;
    var c = pixel.c;
    if (side(a, b, c) < 0) {
        let swapped = b;
        b = c;
        c = swapped;
    }
    let own = vec2<i32>(pixel.position.xy);
    var number = 1u;  // the pixel itself, independent of the fill rule
    for (var lane = 0; lane < 4; lane++) {
        let other = (own & vec2<i32>(-2)) + vec2<i32>(lane & 1, lane >> 1u);
        let centre = 256 * other + 128;
        if (any(other != own) && passes(a, b, centre) && passes(b, c, centre)
                && passes(c, a, centre)) {
            number += 1u;
        }
    }
    atomicAdd(&counts[4u * pixel.polygon], 1u);
    atomicAdd(&counts[4u * pixel.polygon + 1u], 12u / number);
    if (number == 4u) {
        atomicAdd(&counts[4u * pixel.polygon + 2u], 1u);
    }
    let word = pixel.triangle >> 5u;
    let bit = 1u << (pixel.triangle & 31u);
    // The load spares most pixels the second operation.
    if ((atomicLoad(&covering[word]) & bit) == 0u && (atomicOr(&covering[word], bit) & bit) == 0u) {
        atomicAdd(&counts[4u * pixel.polygon + 3u], 1u);
    }
    return vec4<f32>(1.0);
}
