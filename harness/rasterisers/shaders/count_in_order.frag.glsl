// Count fragments, quads, complete quads and covering triangles if lanes cannot exchange values;
// valid only if a triangle is finished before the next begins. The cell of a quad is raised to 8
// times the triangle's number and then counts lanes: the lane that raises it counts the quad, the
// fourth lane a complete quad. The lane that raises `newest` counts the triangle.

#ifdef DEPTH
layout(early_fragment_tests) in;  // do not count hidden fragments
#endif

flat in uint owner;
flat in vec4 colour;

layout(std430, binding = 0) buffer Counts {
    uint counts[];  // fragments, quads, unused, complete quads, covering triangles of polygon 0, ...
};

layout(std430, binding = 1) buffer Last {
    uint newest;  // the last triangle that covered a sample
    uint last[];  // for each quad of the viewport: 8 * the last triangle that touched it + lanes
};

uniform uint triangle;  // 1 + number of the triangle that is drawn
uniform int columns;  // quads in a row of the viewport

out vec4 fragment;

void main() {
    fragment = colour;
    int quad = (int(gl_FragCoord.y) >> 1) * columns + (int(gl_FragCoord.x) >> 1);
    atomicAdd(counts[5u * owner], 1u);
    if (atomicMax(last[quad], 8u * triangle) < 8u * triangle) {
        atomicAdd(counts[5u * owner + 1u], 1u);
    }
    if (atomicAdd(last[quad], 1u) == 8u * triangle + 3u) {
        atomicAdd(counts[5u * owner + 3u], 1u);
    }
    if (atomicMax(newest, triangle) < triangle) {
        atomicAdd(counts[5u * owner + 4u], 1u);
    }
}
