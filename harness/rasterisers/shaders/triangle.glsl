// Triangle set-up of the compute shaders, with edge functions in exact 64-bit integers. A workgroup
// executes a job: some rows of a triangle's bounding box.

layout(local_size_x = 32) in;

layout(std430, binding = 0) readonly buffer Points { ivec2 points[]; };  // in 1/256 px
layout(std430, binding = 1) readonly buffer Polygons { uint polygons[]; };  // of each point
layout(std430, binding = 2) readonly buffer Indices { int indices[]; };
layout(std430, binding = 3) readonly buffer Jobs { ivec4 jobs[]; };  // triangle, rows from..to

#ifdef COUNT
layout(std430, binding = 4) buffer Counts {
    uint counts[];  // two numbers of polygon 0, two of polygon 1, ...
};
#else
layout(binding = 0, r32ui) writeonly uniform uimage2D picture;
#endif

uniform int number;  // of jobs
uniform ivec4 window;  // first column and row, last column and row of the drawn window

// constant + per_row * y - per_column * x is an edge function at the centre of pixel (x, y), minus 1
// if the top-left rule excludes the edge itself: a pixel is inside if the value is not negative.
struct Edge {
    int64_t constant;
    int64_t per_row;
    int64_t per_column;
};

int get_job() {
    return int(gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x);
}

Edge make_edge(ivec2 from, ivec2 to) {
    int dx = to.x - from.x;
    int dy = to.y - from.y;
    bool closed = dy < 0 || (dy == 0 && dx > 0);
    int64_t constant = int64_t(dx) * int64_t(128 - from.y) - int64_t(dy) * int64_t(128 - from.x);
    return Edge(constant - int64_t(closed ? 0 : 1), int64_t(dx) * 256L, int64_t(dy) * 256L);
}

// A triangle made counter-clockwise; not solid if it has no area.
struct Triangle {
    ivec2 first;  // pixel of the bounding box
    ivec2 last;
    uint polygon;
    bool solid;
    Edge edges[3];
};

int64_t evaluate(Edge e, int x, int y) {
    return e.constant + e.per_row * int64_t(y) - e.per_column * int64_t(x);
}

// Twice the signed area, in 1/65536 px^2.
int64_t doubled_area(ivec2 a, ivec2 b, ivec2 c) {
    return int64_t(b.x - a.x) * int64_t(c.y - a.y) - int64_t(b.y - a.y) * int64_t(c.x - a.x);
}

// First pixel whose centre is at or above `low`, last pixel whose centre is at or below `high`.
ivec2 first_pixel(ivec2 low) { return (low + 127) >> 8; }
ivec2 last_pixel(ivec2 high) { return (high - 128) >> 8; }

Triangle load_triangle(ivec4 part) {
    int start = 3 * part.x;
    ivec2 a = points[indices[start]];
    ivec2 b = points[indices[start + 1]];
    ivec2 c = points[indices[start + 2]];
    Triangle t;
    t.polygon = polygons[indices[start]];
    t.first = max(ivec2(first_pixel(min(a, min(b, c))).x, part.y), window.xy);
    t.last = min(ivec2(last_pixel(max(a, max(b, c))).x, part.z), window.zw);
    int64_t doubled = doubled_area(a, b, c);
    t.solid = doubled != 0L;
    if (doubled < 0L) {
        ivec2 swapped = b;
        b = c;
        c = swapped;
    }
    t.edges = Edge[3](make_edge(a, b), make_edge(b, c), make_edge(c, a));
    return t;
}

uint colour(uint polygon) {
    return (((polygon + 1u) * 2654435761u) >> 8) | 0xFF404040u;
}
