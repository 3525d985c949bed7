// Flips make the triangles of a polygon cheaper to draw, on the same vertices.
//
// Two triangles that share an edge are a quadrilateral. Where it is strictly convex it has another
// diagonal, and taking that one is a flip. ORDER.md says in which order flips are made, so that
// this file, flip_triangles.hpp and Python's triangulators.flip give the same triangles.

const MOST = 2 ** 25; // whole coordinates up to this have exact turns and lengths in doubles
const EXACT = 1.6e8; // a sum of three squared distances up to which whole in-circle tests are exact
const NOTHING = 1e-300; // more than what underflow takes from a product

// Kept between calls, as long as the longest list of triangles so far.
let corner = new Int32Array(0); // the point that a half-edge begins at; three half-edges a triangle
let twin = corner; // the half-edge on the other side; negative where there is none
let stack = corner; // half-edges to look at
let slots = corner; // half-edges by the points that they join: a hash table, open addressing
let waiting = new Uint8Array(0); // whether a half-edge is in the stack

const isList = (list) => (Array.isArray(list) || ArrayBuffer.isView(list)) && (list.length === 0 || typeof list[0] === "number");
const next = (e) => (e % 3 === 2 ? e - 2 : e + 1);
const previous = (e) => (e % 3 === 0 ? e + 2 : e - 1);
const whole = (...values) => values.every((v) => Math.abs(v) <= MOST && v === Math.floor(v));

/**
 * Flip diagonals in place while a flip gains.
 *
 * @param {number[] | Uint16Array | Uint32Array | Int32Array} triangles three indices a triangle,
 *     all wound alike, as earcut returns them
 * @param {ArrayLike<number>} vertices flat coordinates, as earcut takes them
 * @param {{dimensions?: number, by?: "l1" | "euclidean" | "delaunay"}} [options] numbers a vertex
 *     (2), of which the first two are used; what a flip must lessen: the diagonal's length,
 *     |dx| + |dy| ("l1") or Euclidean, or the angles that it lies in ("delaunay")
 * @returns {number} how many flips were made
 * @throws {RangeError} where an index is not one of a vertex, or an option is none of those above
 * @throws {TypeError} where triangles or vertices are no lists of numbers
 */
export default function flip(triangles, vertices, {dimensions = 2, by = "l1"} = {}) {
    const delaunay = by === "delaunay", l1 = by === "l1";
    if (!delaunay && !l1 && by !== "euclidean") {
        throw new RangeError(`flip: by is "l1", "euclidean" or "delaunay", not ${by}`);
    }
    if (!(dimensions >= 2 && dimensions === Math.floor(dimensions))) {
        throw new RangeError(`flip: dimensions are a whole number from 2 on, not ${dimensions}`);
    }
    if (!isList(triangles) || !isList(vertices)) {
        throw new TypeError("flip: triangles and vertices are flat arrays of numbers, in three.js those in attributes' .array");
    }
    const count = triangles.length - triangles.length % 3;
    let size = link(triangles, count, Math.floor(vertices.length / dimensions));
    let flips = 0;
    let winding = 0; // of the first triangle that turns at all
    for (let e = 0; size && delaunay && !winding && e < count; e += 3) {
        const a = corner[e] * dimensions, b = corner[e + 1] * dimensions, c = corner[e + 2] * dimensions;
        // A point that is no number turns nowhere.
        winding = Math.sign((vertices[b] - vertices[a]) * (vertices[c + 1] - vertices[a + 1]) -
            (vertices[b + 1] - vertices[a + 1]) * (vertices[c] - vertices[a])) || 0;
    }

    while (size) {
        const e = stack[--size], f = twin[e];
        waiting[e] = 0;
        if (f < 0) continue;

        // The diagonal b-c lies between the triangles a, b, c of e and d, c, b of f.
        const e1 = next(e), e2 = previous(e), f1 = next(f), f2 = previous(f);
        const a = corner[e2], d = corner[f2];
        const i = a * dimensions, j = corner[e] * dimensions, k = corner[f] * dimensions, l = d * dimensions;
        const ax = vertices[i], ay = vertices[i + 1], bx = vertices[j], by = vertices[j + 1];
        const cx = vertices[k], cy = vertices[k + 1], dx = vertices[l], dy = vertices[l + 1];
        const x = dx - ax, y = dy - ay, u = cx - bx, v = cy - by;

        if (delaunay ? !inCircle(winding, ax, ay, bx, by, cx, cy, dx, dy) :
            l1 ? !(Math.abs(x) + Math.abs(y) < Math.abs(u) + Math.abs(v)) :
                !(x * x + y * y < u * u + v * v)) continue;

        // Both new triangles, a, b, d and a, d, c, must turn, for certain, and the same way.
        const p = (bx - ax) * y, q = (by - ay) * x, r = x * (cy - ay), s = y * (cx - ax);
        const turn = p - q, other = r - s;
        if (!(turn > 0 ? other > 0 : turn < 0 && other < 0)) continue;
        if (!(Math.abs(turn) > 4e-16 * (Math.abs(p) + Math.abs(q)) + NOTHING &&
            Math.abs(other) > 4e-16 * (Math.abs(r) + Math.abs(s)) + NOTHING ||
            whole(ax, ay, bx, by, cx, cy, dx, dy))) continue;

        flips++;
        corner[e] = d;
        corner[f] = a;
        const below = twin[f2], above = twin[e2];
        twin[e] = below;
        twin[f] = above;
        twin[e2] = f2;
        twin[f2] = e2;
        if (below >= 0) { twin[below] = e; if (!waiting[e]) waiting[stack[size++] = e] = 1; }
        if (above >= 0) { twin[above] = f; if (!waiting[f]) waiting[stack[size++] = f] = 1; }
        if (twin[e1] >= 0 && !waiting[e1]) waiting[stack[size++] = e1] = 1;
        if (twin[f1] >= 0 && !waiting[f1]) waiting[stack[size++] = f1] = 1;
    }
    if (flips) for (let e = 0; e < count; e++) triangles[e] = corner[e];
    return flips;
}

/**
 * Find the twins of all half-edges, put one of each pair on the stack; return its size.
 *
 * A slot of the hash table has the last of those half-edges of an edge that wait for a twin, all in
 * one direction. While it waits, one holds -2 - the next in `twin`, the last one the first: a ring,
 * so its ends are found in one step, and any number of equal edges costs the same each.
 */
function link(triangles, count, points) {
    let bits = 4;
    while (1 << bits < count + (count >> 1)) bits++;
    if (corner.length < count) {
        corner = new Int32Array(count);
        twin = new Int32Array(count);
        stack = new Int32Array(count);
        waiting = new Uint8Array(count);
    }
    if (slots.length < 1 << bits) slots = new Int32Array(1 << bits);
    const shift = 32 - bits, mask = (1 << bits) - 1;
    slots.fill(-1, 0, mask + 1);
    waiting.fill(0, 0, count);

    let size = 0;
    for (let first = 0; first < count; first += 3) {
        const i = triangles[first], j = triangles[first + 1], k = triangles[first + 2];
        if (!(i >>> 0 === i && j >>> 0 === j && k >>> 0 === k && i < points && j < points && k < points)) {
            throw new RangeError(`flip: triangle ${first / 3} is ${[i, j, k]}: indices are 0 to ${points - 1}`);
        }
        corner[first] = i;
        corner[first + 1] = j;
        corner[first + 2] = k;
        let tail = i;
        for (let e = first; e < first + 3; e++) {
            const head = e < first + 2 ? corner[e + 1] : i;
            const low = tail < head ? tail : head, high = tail < head ? head : tail;
            let at = Math.imul(low + Math.imul(high, 0x9e3779b1), 0x85ebca6b) >>> shift;
            let last, against = false; // against: whether those that wait run from head to tail
            for (; (last = slots[at]) >= 0; at = at + 1 & mask) {
                const start = corner[last];
                if (start === head && corner[next(last)] === tail) {
                    against = true;
                    break;
                }
                if (start === tail && corner[next(last)] === head) break;
            }
            if (last < 0 || twin[last] >= 0) {
                slots[at] = e;
                twin[e] = -2 - e;
            } else if (against) {
                const found = -2 - twin[last];
                if (found !== last) twin[last] = twin[found];
                twin[found] = e;
                twin[e] = found;
                waiting[stack[size++] = found] = 1;
            } else {
                slots[at] = e;
                twin[e] = twin[last];
                twin[last] = -2 - e;
            }
            tail = head;
        }
    }
    return size;
}

/** Whether d lies inside the circle through a, b, c, for certain; they turn left if winding > 0. */
function inCircle(winding, ax, ay, bx, by, cx, cy, dx, dy) {
    const px = ax - dx, py = ay - dy, qx = bx - dx, qy = by - dy, rx = cx - dx, ry = cy - dy;
    const p = px * px + py * py, q = qx * qx + qy * qy, r = rx * rx + ry * ry;
    const a = qx * ry - qy * rx, b = rx * py - ry * px, c = px * qy - py * qx;
    const inside = (p * a + q * b + r * c) * winding, size = p + q + r;
    if (Math.abs(inside) > 1e-15 * size * size + NOTHING) return inside > 0;
    if (size <= EXACT && inside === 0 || !whole(ax, ay, bx, by, cx, cy, dx, dy)) return false;
    if (size <= EXACT) return inside > 0;
    const exact = BigInt(p) * BigInt(a) + BigInt(q) * BigInt(b) + BigInt(r) * BigInt(c);
    return exact * BigInt(winding) > 0n;
}
