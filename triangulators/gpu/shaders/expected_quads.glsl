// Costs of expected quads: the kernel `_average_blocks` of criteria/features.py for 2x2 pixels.
//
// The operations and their order are those of the kernel. Differences of corners, determinants and
// sums L are exact on a grid; for all other operations `precise` forbids fused instructions. So a
// device that rounds double divisions correctly returns the same bits as the CPU.

#define COST double

// Cost without a triangulation: adding the cost of a triangle does not change it.
const double NONE = 1e300LF;

double weigh_diagonal(ivec2 along, int longest, bool maximised) {
    return 0.0LF;
}

double common_share(double lost, double doubled_area) {
    precise double side = 1.0LF - lost / doubled_area;
    precise double share = side > 0.0LF ? side * side : 0.0LF;
    return share;
}

double extent(double b, double c) {  // of the values 0, b, c
    return max(0.0LF, max(b, c)) - min(0.0LF, min(b, c));
}

double lowest(dvec2 d) {
    return min(0.0LF, min(d.x, d.y));
}

double sum_triple(dvec2 signs, dvec2 u, dvec2 v, dvec2 w) {
    return -(lowest(signs * u) + lowest(signs * v)) - lowest(signs * w);
}

// The triangle is counter-clockwise: a corner, the apex, the end of `along`.
double weigh_triangle(ivec2 to_apex, ivec2 along, float unit, bool maximised) {
    dvec2 b = double(unit) * dvec2(to_apex), c = double(unit) * dvec2(along);
    dvec2 u = b, v = c - b, w = -c;
    precise double cross = u.x * v.y - u.y * v.x;
    double width = extent(b.x, c.x), height = extent(b.y, c.y);
    precise double pairs = common_share(width, cross) + common_share(height, cross);
    precise double diagonals = common_share(extent(b.x - b.y, c.x - c.y), cross)
                             + common_share(extent(b.x + b.y, c.x + c.y), cross);
    precise double triples = common_share(sum_triple(dvec2(-1.0LF, -1.0LF), u, v, w), cross);
    triples += common_share(sum_triple(dvec2(1.0LF, -1.0LF), u, v, w), cross);
    triples += common_share(sum_triple(dvec2(-1.0LF, 1.0LF), u, v, w), cross);
    triples += common_share(sum_triple(dvec2(1.0LF, 1.0LF), u, v, w), cross);
    precise double squares = triples - diagonals - common_share(width + height, cross);
    precise double quads = 0.5LF * cross * (4.0LF - 2.0LF * pairs + squares) / 4.0LF;
    return maximised ? -quads : quads;
}

const bool HAS_NEGATIVE = true;  // whether triangles have negative costs if maximised

// If sums are equal, the apex with the highest index is taken.
bool precedes(double total, double best) {
    return total <= best;
}

uvec2 words_of(double cost) {
    return unpackDouble2x32(cost);
}
