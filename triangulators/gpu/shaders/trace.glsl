// The triangles behind a filled table: one workgroup a ring, CREW lanes to a pair.
//
// No apex was kept: of the n - 2 that are needed each is found again, from the same sums. Pairs wait
// in a queue; LANES / CREW of them are taken from its front at a time, and each puts up to two
// behind its end. Their order is of no consequence, for what is written is each apex's base.
//
// Ties. Up to SMALL corners the lowest apex wins, as in small_ring.py. Above, edges.py goes by its
// table where corners see many others, and the lowest wins, or by lists of visible pairs, which
// have apexes in descending order, and the highest wins. It decides by the sum of squares of `seen`.
//
// Rounds. llvmpipe ends all loops of an invocation, in silence, once they have made 65,535 rounds
// together. Where the triangles are a chain, 2,048 pairs are traced one after the other, with at
// most 2,048 / CREW rounds each and log2(CREW) to find the best of a crew's: some 50,000.
const int CREWS = LANES / CREW;

shared uint queue[MOST];
shared int tail;
shared int sums[LANES], apexes[LANES];
shared uint squares[LANES];
shared bool highest;

// Whether apex k of sum s comes before apex l of sum t.
bool before(int s, int k, int t, int l) {
    return s < t || (s == t && (highest ? k > l : k < l));
}

void main() {
    ivec4 job = jobs[2 * gl_WorkGroupID.x], more = jobs[2 * gl_WorkGroupID.x + 1];
    int first = job.x, n = job.y, columns = more.x;
    int lane = int(gl_LocalInvocationID.x), crew = lane / CREW, part = lane % CREW;
    int cost = table[job.w + n - 1];
    uint square = 0u;
    for (int j = lane; j < n; j += LANES) {
        square += seen[first + j] * seen[first + j];
    }
    squares[lane] = square;
    barrier();
    if (lane == 0) {
        uint low = 0u, carry = 0u, over;
        for (int l = 0; l < LANES; l++) {
            low = uaddCarry(low, squares[l], over);
            carry += over;
        }
        highest = more.y == 1 && carry == 0u && low <= uint(more.z);
        bases[first] = uint(cost);
        queue[0] = uint(n - 1) << 16;
        tail = cost < NONE ? 1 : 0;
    }
    barrier();
    int head = 0, end = tail;
    while (head < end) {
        int mine = head + crew;
        int i = 0, j = 0, best = NONE, apex = -1;
        if (mine < end) {
            i = int(queue[mine] & 0xFFFFu);
            j = int(queue[mine] >> 16);
            for (int k = i + 1 + part; k < j; k += CREW) {
                int sum = table[job.w + i * columns + k] + table[job.w + k * columns + j];
                if (sum < NONE && before(sum, k, best, apex)) {
                    best = sum;
                    apex = k;
                }
            }
        }
        sums[lane] = best;
        apexes[lane] = apex;
        barrier();
        for (int others = CREW / 2; others > 0; others /= 2) {
            int other = lane + others;
            if (part < others && sums[other] < NONE &&
                before(sums[other], apexes[other], sums[lane], apexes[lane])) {
                sums[lane] = sums[other];
                apexes[lane] = apexes[other];
            }
            barrier();
        }
        apex = apexes[lane];
        if (part == 0 && mine < end && apex > 0) {
            bases[first + apex] = uint(i) | uint(j) << 16;
            if (apex - i > 1) {
                queue[atomicAdd(tail, 1)] = uint(i) | uint(apex) << 16;
            }
            if (j - apex > 1) {
                queue[atomicAdd(tail, 1)] = uint(apex) | uint(j) << 16;
            }
        }
        barrier();
        head = min(head + CREWS, end);
        end = tail;
        barrier();
    }
}
