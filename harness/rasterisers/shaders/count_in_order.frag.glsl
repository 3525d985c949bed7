// Counts fragments, quads and whole quads where lanes cannot see each other: only right where a
// triangle is finished before the next begins. A quad's cell is raised to 8 times the triangle's
// number and then counts its lanes: the lane that raises it counts the quad, a fourth one that it
// is whole.

#ifdef DEPTH
layout(early_fragment_tests) in;  // what is hidden is not counted
#endif

flat in uint owner;
flat in vec4 colour;

layout(std430, binding = 0) buffer Counts {
    uint counts[];  // fragments, quads, nothing, whole quads of polygon 0, of polygon 1, ...
};

layout(std430, binding = 1) buffer Last {
    uint last[];  // for each quad of the viewport: 8 * the last triangle that touched it + lanes
};

uniform uint triangle;  // 1 + its number
uniform int columns;  // quads in a row of the viewport

out vec4 fragment;

void main() {
    fragment = colour;
    int quad = (int(gl_FragCoord.y) >> 1) * columns + (int(gl_FragCoord.x) >> 1);
    atomicAdd(counts[4u * owner], 1u);
    if (atomicMax(last[quad], 8u * triangle) < 8u * triangle) {
        atomicAdd(counts[4u * owner + 1u], 1u);
    }
    if (atomicAdd(last[quad], 1u) == 8u * triangle + 3u) {
        atomicAdd(counts[4u * owner + 3u], 1u);
    }
}
