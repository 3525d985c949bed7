// Count fragments, quads, helper lanes, partial quads and covering triangles of each polygon.
//
// Derivatives are differences between the lanes of a 2x2 quad. Derivatives of the helper flag show
// each lane which of its three neighbours are helper lanes. The first covered lane counts the quad, and
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
    float row_helper = helper + (right ? -1.0 : 1.0) * dFdxFine(helper);
    float column_helper = helper + (top ? -1.0 : 1.0) * dFdyFine(helper);
    float diagonal_helper = row_helper + (top ? -1.0 : 1.0) * dFdyFine(row_helper);

    // Lanes in the order bottom left, bottom right, top left, top right.
    bool first = true;
    if (right && !top) first = row_helper > 0.5;
    if (top && !right) first = column_helper > 0.5 && diagonal_helper > 0.5;
    if (top && right) first = row_helper > 0.5 && column_helper > 0.5 && diagonal_helper > 0.5;

    fragment = colour;
    if (!gl_HelperInvocation) {
        atomicAdd(counts[5u * owner], 1u);
        if (first) {
            uint helpers = uint(row_helper + column_helper + diagonal_helper + 0.5);
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
