// Costs of the half-perimeter: the L1 lengths of diagonals, in units of the ring's grid.

#define COST int

// Cost without a triangulation; the sum of two fits an int.
const int NONE = (1 << 30) - 1;

// Cost of a diagonal: the L1 length; if maximised, `longest` (width plus height of the ring's
// bounding box) minus the length, so that no cost is negative.
int weigh_diagonal(ivec2 along, int longest, bool maximised) {
    int length = abs(along.x) + abs(along.y);
    return maximised ? longest - length : length;
}

int weigh_triangle(ivec2 to_apex, ivec2 along, float unit, bool maximised) {
    return 0;
}

const bool HAS_NEGATIVE = false;  // whether triangles have negative costs if maximised

// If sums are equal, the apex with the lowest index is taken.
bool precedes(int total, int best) {
    return total < best;
}

uvec2 words_of(int cost) {
    return uvec2(cost, 0);
}
