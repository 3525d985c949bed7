// Which corners see each other, and what the diagonal between them costs: one workgroup for the
// row of corner i, a lane for each j.
//
// i sees j where the segment leads into the angles at both and meets no side but those that end at
// i or j. A side meets it where its ends are not on one side of the segment, nor the segment's ends
// on one side of it, touching counted; where all four are on one line, where their boxes overlap.
// Runs of BLOCK sides are passed over where their box is apart from the segment's, or on one side
// of it.
//
// Rounds (see trace.glsl): 2,048 / LANES corners j a lane, 2,048 sides and 64 boxes each.
uniform int worst;

shared ivec2 at[MOST];
shared ivec4 boxes[MOST / BLOCK];

bool apart(ivec4 box, ivec4 other) {
    return any(lessThan(box.zw, other.xy)) || any(lessThan(other.zw, box.xy));
}

// Whether a and b lie on the same side of the line along d, as seen from a point on it.
bool together(ivec2 d, ivec2 a, ivec2 b) {
    return (left(d, a) && left(d, b)) || (left(a, d) && left(b, d));
}

bool blocked(int i, int j, int n) {
    ivec2 from = at[i], to = at[j], d = to - from;
    ivec4 own = ivec4(min(from, to), max(from, to));
    for (int block = 0; block * BLOCK < n; block++) {
        ivec4 box = boxes[block];
        // Its corners furthest to the left and to the right of the segment.
        ivec2 leftmost = ivec2(d.y < 0 ? box.z : box.x, d.x > 0 ? box.w : box.y);
        ivec2 rightmost = box.xy + box.zw - leftmost;
        if (apart(box, own) || together(d, leftmost - from, rightmost - from)) {
            continue;
        }
        int end = min(n, (block + 1) * BLOCK);
        for (int a = block * BLOCK; a < end; a++) {
            int b = a + 1 < n ? a + 1 : 0;
            if (a == i || a == j || b == i || b == j) {
                continue;
            }
            ivec2 p = at[a], q = at[b];
            bool beside = apart(ivec4(min(p, q), max(p, q)), own);
            if (!beside && !together(d, p - from, q - from) &&
                !together(q - p, from - p, to - p)) {
                return true;
            }
        }
    }
    return false;
}

void main() {
    int i = int(gl_WorkGroupID.x), lane = int(gl_LocalInvocationID.x);
    ivec4 job = jobs[2 * gl_WorkGroupID.y];
    int first = job.x, n = job.y, longest = job.z;
    int columns = jobs[2 * gl_WorkGroupID.y + 1].x;
    if (i >= columns) {
        return;
    }
    for (int k = lane; k < n; k += LANES) {
        at[k] = corners[first + k];
    }
    barrier();
    for (int block = lane; block * BLOCK < n; block += LANES) {
        ivec4 box = ivec4(at[block * BLOCK], at[block * BLOCK]);
        for (int k = block * BLOCK + 1; k <= min(n, (block + 1) * BLOCK); k++) {
            ivec2 corner = at[k < n ? k : 0];
            box = ivec4(min(box.xy, corner), max(box.zw, corner));
        }
        boxes[block] = box;
    }
    barrier();
    for (int j = lane; j < columns; j += LANES) {
        int weight = NONE;
        if (i < j && j < n) {
            if (j == i + 1 || j - i == n - 1) {
                weight = 0;
            } else {
                ivec2 d = at[j] - at[i];
                ivec2 before = at[i] - at[i > 0 ? i - 1 : n - 1], after = at[i + 1] - at[i];
                ivec2 before_j = at[j] - at[j - 1], after_j = at[j + 1 < n ? j + 1 : 0] - at[j];
                if (inward(before, after, d) && inward(before_j, after_j, -d) &&
                    !blocked(i, j, n)) {
                    int length = abs(d.x) + abs(d.y);
                    weight = worst == 1 ? longest - length : length;
                }
            }
            if (weight < NONE) {
                atomicAdd(seen[first + j], 1u);
            }
        }
        table[job.w + i * columns + j] = weight;
    }
}
