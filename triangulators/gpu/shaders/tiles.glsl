// One diagonal of tiles of the table, TILE x TILE each: weights of pairs become least costs.
//
// Tile (I, J) needs those left of it in its row and below it in its column, which are nearer to
// the table's diagonal: so tiles with J - I = 0, 1, 2, ... are done one dispatch after the other,
// and those of one dispatch, of all rings, at the same time.
//
// Apexes in tiles K strictly between are a min-plus product of two finished tiles,
//
//     cost(i, j) <- min over k in K of cost(i, k) + cost(k, j),
//
// with four sums in registers for two values of each tile read. What is left are apexes in I and
// J themselves, which need other pairs of this very tile: pairs are done by ascending j - i, as
// many as there are rows at once, PARTS lanes to a pair. No orientation is tested: corners that
// see each other, in the ring's order, turn left.
uniform int away;  // J - I

const int WIDTH = TILE + 1;  // odd, so that columns lie in different banks
const int PARTS = LANES / TILE;
const int STEP = TILE / 2;

shared int row[TILE * WIDTH];     // a tile of row I
shared int column[TILE * WIDTH];  // a tile of column J
shared int own[TILE * WIDTH];
shared int found[LANES];

void main() {
    ivec4 job = jobs[2 * gl_WorkGroupID.y];
    int n = job.y, columns = jobs[2 * gl_WorkGroupID.y + 1].x;
    int top = int(gl_WorkGroupID.x) * TILE, beside = top + away * TILE;
    if (beside >= columns) {
        return;
    }
    int lane = int(gl_LocalInvocationID.x);
    int r = lane / STEP, c = lane % STEP;
    ivec4 best = ivec4(NONE);  // at (r, c), (r, c + STEP), (r + STEP, c), (r + STEP, c + STEP)
    for (int between = top + TILE; between < beside; between += TILE) {
        for (int at = lane; at < TILE * TILE; at += LANES) {
            int y = at / TILE, x = at % TILE;
            row[y * WIDTH + x] = table[job.w + (top + y) * columns + between + x];
            column[y * WIDTH + x] = table[job.w + (between + y) * columns + beside + x];
        }
        barrier();
        for (int k = 0; k < TILE; k++) {
            ivec2 a = ivec2(row[r * WIDTH + k], row[(r + STEP) * WIDTH + k]);
            ivec2 b = ivec2(column[k * WIDTH + c], column[k * WIDTH + c + STEP]);
            best = min(best, ivec4(a.x + b, a.y + b));
        }
        barrier();
    }
    own[r * WIDTH + c] = best.x;
    own[r * WIDTH + c + STEP] = best.y;
    own[(r + STEP) * WIDTH + c] = best.z;
    own[(r + STEP) * WIDTH + c + STEP] = best.w;
    for (int at = lane; at < TILE * TILE; at += LANES) {
        int y = at / TILE, x = at % TILE;
        row[y * WIDTH + x] = table[job.w + (top + y) * columns + top + x];
        column[y * WIDTH + x] = table[job.w + (beside + y) * columns + beside + x];
    }
    barrier();
    bool alone = away == 0;  // the tile is its own row and column
    int y = lane / PARTS, part = lane % PARTS;
    for (int step = alone ? 1 : 1 - TILE; step < TILE; step++) {
        int x = y + step, i = top + y, j = beside + x;
        bool there = 0 <= x && x < TILE && j < n;
        int least = NONE;
        if (there) {
            for (int k = y + 1 + part; k < (alone ? x : TILE); k += PARTS) {
                int a = alone ? own[y * WIDTH + k] : row[y * WIDTH + k];
                least = min(least, a + own[k * WIDTH + x]);
            }
            for (int k = part; k < (alone ? 0 : x); k += PARTS) {
                least = min(least, own[y * WIDTH + k] + column[k * WIDTH + x]);
            }
        }
        found[lane] = least;
        barrier();
        if (part == 0 && 0 <= x && x < TILE) {
            int weight = there ? table[job.w + i * columns + j] : NONE;
            least = own[y * WIDTH + x];
            for (int p = 0; p < PARTS; p++) {
                least = min(least, found[lane + p]);
            }
            least = j == i + 1 ? 0 : least;
            own[y * WIDTH + x] = max(least, weight) < NONE ? least + weight : NONE;
        }
        barrier();
    }
    for (int at = lane; at < TILE * TILE; at += LANES) {
        int y = at / TILE, x = at % TILE;
        table[job.w + (top + y) * columns + beside + x] = own[y * WIDTH + x];
    }
}
