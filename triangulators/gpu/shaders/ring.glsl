// The optimum of a ring of n <= MAX_SIZE corners: one workgroup, all costs in shared memory.
//
// Another file defines the cost: COST (a type), NONE, weigh_diagonal, weigh_triangle, HAS_NEGATIVE,
// precedes, words_of.
//
// Pairs (i, i + d) are computed in ascending order of d, a lane for each i, with a barrier after
// each d. An apex is allowed if the triangle turns left, as in full_table.py, so no visibility is
// needed.
//
// The table. cost(i, i + d) is in row d, column i, so that for each m adjacent lanes read adjacent
// words of rows m and d - m. Row d has MAX_SIZE - d columns, so that costs of 8 bytes and apexes of
// 4 bytes take 24 KiB for 64 corners; OpenGL guarantees 32 KiB of shared memory.
//
// Ties. Apexes are tried in ascending order; `precedes` decides between equal sums as the CPU does.
layout(local_size_x = LANES) in;

layout(std430, binding = 0) readonly buffer Corners { ivec2 corners[]; };
// For each ring: index of the first corner, number of corners, width plus height of the bounding
// box, bits of the unit of the grid as a float.
layout(std430, binding = 1) readonly buffer Jobs { ivec4 jobs[]; };
// A word for each corner: at the first and the last corner of a ring the low and the high word of
// the cost, at each other corner k the base i | j << 16 of the triangle i, k, j with this apex.
layout(std430, binding = 2) writeonly buffer Bases { uint bases[]; };

uniform int number;  // of jobs
uniform int worst;   // 1 to maximise

const int PAIRS = MAX_SIZE * (MAX_SIZE - 1) / 2;
shared COST costs[PAIRS];
shared int apexes[PAIRS];
shared ivec2 at[MAX_SIZE];

const int MARK = 1 << 16;  // bit of an apex if the pair is a side of a triangle of the optimum
const uint NO_RESULT = 0xFFFFFFFFu;  // both words of the cost of a ring without a triangulation

// Index of the first element of row d in `costs` and `apexes`.
int row(int d) {
    return (d - 1) * (2 * MAX_SIZE - d) / 2;
}

void main() {
    int job = int(gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x);
    if (job >= number) {
        return;
    }
    int first = jobs[job].x, n = jobs[job].y, longest = jobs[job].z;
    float unit = intBitsToFloat(jobs[job].w);
    bool maximised = worst == 1, any_sign = HAS_NEGATIVE && maximised;
    int lane = int(gl_LocalInvocationID.x);
    for (int k = lane; k < n; k += LANES) {
        at[k] = corners[first + k];
        if (k < n - 1) {
            costs[k] = COST(0);  // the sides
        }
    }
    barrier();
    for (int d = 2; d < n; d++) {
        for (int i = lane; i + d < n; i += LANES) {
            ivec2 from = at[i], along = at[i + d] - from;
            COST weight = COST(0);
            bool fits = true;
            if (d < n - 1) {  // not the side that closes the ring
                ivec2 before = from - at[i > 0 ? i - 1 : n - 1];
                fits = inward(before, at[i + 1] - from, along);
                weight = weigh_diagonal(along, longest, maximised);
            }
            COST best = NONE;
            int apex = 0, before_apex = i, after_apex = row(d - 1) + i + 1;
            for (int m = 1; m < (fits ? d : 0); m++) {
                ivec2 to_apex = at[i + m] - from;
                COST total = costs[before_apex] + costs[after_apex];
                if ((any_sign || precedes(total, best)) && left(to_apex, along)) {
                    total += weigh_triangle(to_apex, along, unit, maximised);
                    if (precedes(total, best)) {
                        best = total;
                        apex = i + m;
                    }
                }
                before_apex += MAX_SIZE - m;  // row(m + 1) + i
                after_apex -= MAX_SIZE - d + m;  // row(d - m - 1) + i + m + 1
            }
            costs[row(d) + i] = best < NONE ? best + weight : NONE;
            apexes[row(d) + i] = apex;
        }
        barrier();
    }
    int top = row(n - 1);
    COST cost = costs[top];
    bool solved = cost < NONE;
    if (lane == 0) {
        uvec2 words = solved ? words_of(cost) : uvec2(NO_RESULT);
        bases[first] = words.x;
        bases[first + n - 1] = words.y;
        apexes[top] |= MARK;
    }
    barrier();
    // In descending order of d: a marked pair is the base of a triangle, whose other sides are then
    // marked.
    for (int d = solved ? n - 1 : 0; d > 1; d--) {
        for (int i = lane; i + d < n; i += LANES) {
            int k = apexes[row(d) + i] - MARK;
            if (k >= 0) {
                bases[first + k] = uint(i) | uint(i + d) << 16;
                apexes[row(k - i) + i] |= MARK;
                apexes[row(i + d - k) + k] |= MARK;
            }
        }
        barrier();
    }
}
