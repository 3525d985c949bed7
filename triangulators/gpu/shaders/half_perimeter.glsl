// Costs of the half-perimeter: the L1 lengths of diagonals, in units of the ring's grid.

#define COST int

// Cost without a triangulation; the sum of two fits.
const int NONE = (1 << 30) - 1;

// Maximised, a diagonal costs `longest` (w + h of the ring's box) minus its length, so that no cost
// is negative.
int weigh_diagonal(ivec2 along, int longest, bool maximised) {
    int length = abs(along.x) + abs(along.y);
    return maximised ? longest - length : length;
}

int weigh_triangle(ivec2 to_apex, ivec2 along, float unit, bool maximised) {
    return 0;
}

const bool HAS_NEGATIVE = false;  // whether triangles have negative costs if maximised

// The lowest apex of equals.
bool precedes(int total, int best) {
    return total < best;
}

uvec2 words_of(int cost) {
    return uvec2(cost, 0);
}
