// Orientation of integer vectors, exactly.
//
// Corners span at most 2^24 units, so products of two differences have up to 48 bits. Products are
// computed as 64 bits in two words and compared: the high words as signed, the low words as unsigned
// integers. If all differences are below 2^15, products fit 30 bits, and WIDE is not defined.

// Whether a * b > c * d.
bool exceeds(int a, int b, int c, int d) {
#ifdef WIDE
    int high, low, other_high, other_low;
    imulExtended(a, b, high, low);
    imulExtended(c, d, other_high, other_low);
    return high > other_high || (high == other_high && uint(low) > uint(other_low));
#else
    return a * b > c * d;
#endif
}

// Whether b is left of a, both as seen from one point.
bool left(ivec2 a, ivec2 b) {
    return exceeds(a.x, b.y, a.y, b.x);
}

// Whether d leads into the angle between the sides `before` and `after` of a corner: left of both,
// or of either if the angle is not convex.
bool inward(ivec2 before, ivec2 after, ivec2 d) {
    bool left_of_after = left(after, d), left_of_before = left(before, d);
    return (left_of_after && left_of_before) || ((left_of_after || left_of_before) && !left(before, after));
}
