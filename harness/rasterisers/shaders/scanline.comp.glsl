// Scan only the span of each row of the triangle.

int64_t floor_divide(int64_t value, int64_t positive) {
    int64_t quotient = value / positive;
    return quotient - int64_t(quotient * positive > value ? 1 : 0);
}

// Narrow the span (first, last) of row y to the inside of an edge.
ivec2 clip(ivec2 span, Edge e, int y) {
    int64_t value = e.constant + e.per_row * int64_t(y);
    if (e.per_column > 0L) {
        int64_t last = floor_divide(value, e.per_column);
        return ivec2(span.x, last < int64_t(span.y) ? int(last) : span.y);
    }
    if (e.per_column < 0L) {
        int64_t first = -floor_divide(value, -e.per_column);
        return ivec2(first > int64_t(span.x) ? int(first) : span.x, span.y);
    }
    return value < 0L ? ivec2(span.x, span.x - 1) : span;
}

void main() {
    if (get_job() >= number) return;
    Triangle t = load_triangle(jobs[get_job()]);
    if (!t.solid || t.last.x < t.first.x) return;
    uint rows = 0u;
    uint hits = 0u;
    for (int y = t.first.y + int(gl_LocalInvocationIndex); y <= t.last.y; y += 32) {
        ivec2 span = ivec2(t.first.x, t.last.x);
        for (int k = 0; k < 3; k++) span = clip(span, t.edges[k], y);
        rows++;
#ifdef COUNT
        hits += uint(max(span.y - span.x + 1, 0));
#else
        for (int x = span.x; x <= span.y; x++) {
            imageStore(picture, ivec2(x, y), uvec4(colour(t.polygon)));
        }
#endif
    }
#ifdef COUNT
    atomicAdd(counts[2u * t.polygon], rows);
    atomicAdd(counts[2u * t.polygon + 1u], hits);
#endif
}
