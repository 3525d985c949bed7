// Transform a vertex in 1/256 px and pass the polygon and its colour.

in ivec2 position;
in uint polygon;
#ifdef DEPTH
in int depth;  // 0 to 2^24, from near to far
#endif

uniform vec2 size;  // of the viewport, in 1/256 px

flat out uint owner;
flat out vec4 colour;

void main() {
    gl_Position = vec4(2.0 * vec2(position) / size - 1.0, 0.0, 1.0);
#ifdef DEPTH
    gl_Position.z = float(depth) / 8388608.0 - 1.0;
#endif
    owner = polygon;
    uint mixed = (polygon + 1u) * 2654435761u;
    uint packed_colour = (mixed >> 8) | 0xFF404040u;
    colour = vec4((uvec4(packed_colour) >> uvec4(0u, 8u, 16u, 24u)) & 255u) / 255.0;
}
