// Counts fragments and quads where lanes cannot see each other: only right where a triangle is
// finished before the next begins. A quad is counted by the lane that first writes the
// triangle's number to the quad's cell.

#ifdef DEPTH
layout(early_fragment_tests) in;  // what is hidden is not counted
#endif

flat in uint owner;
flat in vec4 colour;

layout(std430, binding = 0) buffer Counts {
    uint counts[];  // fragments, quads, helper lanes of polygon 0, of polygon 1, ...
};

layout(std430, binding = 1) buffer Last {
    uint last[];  // for each quad of the viewport, 1 + the last triangle that touched it
};

uniform uint triangle;  // 1 + its number
uniform int columns;  // quads in a row of the viewport

out vec4 fragment;

void main() {
    fragment = colour;
    int quad = (int(gl_FragCoord.y) >> 1) * columns + (int(gl_FragCoord.x) >> 1);
    atomicAdd(counts[3u * owner], 1u);
    if (atomicExchange(last[quad], triangle) != triangle) {
        atomicAdd(counts[3u * owner + 1u], 1u);
    }
}
