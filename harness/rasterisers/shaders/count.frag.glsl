// Count fragments, quads, helper lanes, partial quads and covering triangles of each polygon.
//
// Derivatives are differences between the lanes of a 2x2 quad. Derivatives of the helper flag show
// each lane which of its three neighbours are helpers. The first covered lane counts the quad, and
// the triangle if it sets the triangle's bit.

#ifdef DEPTH
layout(early_fragment_tests) in;  // do not count hidden fragments
#endif

flat in uint owner;
flat in vec4 colour;

layout(std430, binding = 0) buffer Counts {
    uint counts[];  // fragments, quads, helper lanes, partial quads, covering triangles of polygon 0, ...
};

layout(std430, binding = 1) buffer Covering {
    uint covering[];  // a bit for each triangle
};

uniform int start;  // number of the draw's first triangle

out vec4 fragment;

void main() {
    float helper = gl_HelperInvocation ? 1.0 : 0.0;
    bool right = (int(gl_FragCoord.x) & 1) == 1;
    bool top = (int(gl_FragCoord.y) & 1) == 1;
    // Helper flags of the neighbour in the row, in the column, and diagonally.
    float beside = helper + (right ? -1.0 : 1.0) * dFdxFine(helper);
    float beyond = helper + (top ? -1.0 : 1.0) * dFdyFine(helper);
    float across = beside + (top ? -1.0 : 1.0) * dFdyFine(beside);

    // Lanes in the order bottom left, bottom right, top left, top right.
    bool first = true;
    if (right && !top) first = beside > 0.5;
    if (top && !right) first = beyond > 0.5 && across > 0.5;
    if (top && right) first = beside > 0.5 && beyond > 0.5 && across > 0.5;

    fragment = colour;
    if (!gl_HelperInvocation) {
        atomicAdd(counts[5u * owner], 1u);
        if (first) {
            uint helpers = uint(beside + beyond + across + 0.5);
            atomicAdd(counts[5u * owner + 1u], 1u);
            atomicAdd(counts[5u * owner + 2u], helpers);
            if (helpers > 0u) atomicAdd(counts[5u * owner + 3u], 1u);
            uint triangle = uint(start + gl_PrimitiveID);
            uint bit = 1u << (triangle & 31u);
            // The plain read spares most quads the atomic operation.
            if ((covering[triangle >> 5] & bit) == 0u
                    && (atomicOr(covering[triangle >> 5], bit) & bit) == 0u) {
                atomicAdd(counts[5u * owner + 4u], 1u);
            }
        }
    }
}
