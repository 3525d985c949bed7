// The optimum of a ring of n <= MAX_SIZE corners: one workgroup, the whole table in shared memory.
//
// Pairs (i, i + d) are done by ascending d, a lane for each i; a barrier separates two d. An apex
// counts where the triangle turns left, as in full_table.py, so no visibility is needed.
//
// The table. cost(i, i + d) is at row d, column i: lanes side by side read i + d, k = i + m, m and
// d - m as words side by side, whatever m is. Row d has n - d pairs, so its other d columns are
// free: the apexes of row d, n - d of them, are in row n - d from column d on. Costs and apexes
// fill one square and need no packing: 64 * 64 * 4 bytes are half of what OpenGL guarantees.
//
// Ties. Apexes are tried in ascending order and replaced only by a lower sum: the lowest apex of
// least sum wins, as full_table's way back has it.
layout(local_size_x = LANES) in;

layout(std430, binding = 0) readonly buffer Corners { ivec2 corners[]; };
// For each ring: its first corner, how many, w + h of its box.
layout(std430, binding = 1) readonly buffer Jobs { ivec4 jobs[]; };
// As many as corners: at a ring's first corner the cost, at its k-th the base i | j << 16 of the
// triangle i, k, j. Each k but the first and the last is the apex of exactly one triangle.
layout(std430, binding = 2) writeonly buffer Bases { uint bases[]; };

uniform int number;  // of jobs
uniform int worst;   // 1 to find the longest diagonals: then (w + h - length) is what is least

shared int table[MAX_SIZE * MAX_SIZE];
shared ivec2 at[MAX_SIZE];

const int MARK = -1;

void main() {
    int job = int(gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x);
    if (job >= number) {
        return;
    }
    int first = jobs[job].x, n = jobs[job].y, longest = jobs[job].z;
    int lane = int(gl_LocalInvocationID.x);
    for (int k = lane; k < n; k += LANES) {
        at[k] = corners[first + k];
        table[MAX_SIZE + k] = 0;  // the sides
    }
    barrier();
    for (int d = 2; d < n; d++) {
        for (int i = lane; i + d < n; i += LANES) {
            ivec2 from = at[i], along = at[i + d] - from;
            int weight = 0;
            bool fits = true;
            if (d < n - 1) {  // not the side that closes the ring
                ivec2 before = from - at[i > 0 ? i - 1 : n - 1];
                fits = inward(before, at[i + 1] - from, along);
                weight = abs(along.x) + abs(along.y);
                weight = worst == 1 ? longest - weight : weight;
            }
            int best = NONE, apex = 0;
            for (int m = 1; m < (fits ? d : 0); m++) {
                int total = table[m * MAX_SIZE + i] + table[(d - m) * MAX_SIZE + i + m];
                if (total < best && left(at[i + m] - from, along)) {
                    best = total;
                    apex = i + m;
                }
            }
            table[d * MAX_SIZE + i] = best < NONE ? best + weight : NONE;
            table[(n - d) * MAX_SIZE + d + i] = apex;
        }
        barrier();
    }
    int cost = table[(n - 1) * MAX_SIZE];
    barrier();
    if (lane == 0) {
        bases[first] = uint(cost);
        table[(n - 1) * MAX_SIZE] = MARK;
    }
    barrier();
    // From the top down: a pair that is marked has a triangle, whose other two sides are marked.
    for (int d = cost < NONE ? n - 1 : 0; d > 1; d--) {
        for (int i = lane; i + d < n; i += LANES) {
            if (table[d * MAX_SIZE + i] == MARK) {
                int k = table[(n - d) * MAX_SIZE + d + i];
                bases[first + k] = uint(i) | uint(i + d) << 16;
                table[(k - i) * MAX_SIZE + i] = MARK;
                table[(i + d - k) * MAX_SIZE + k] = MARK;
            }
        }
        barrier();
    }
}
