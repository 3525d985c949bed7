(function (global, factory) {
    typeof exports === 'object' && typeof module !== 'undefined' ? module.exports = factory() :
    typeof define === 'function' && define.amd ? define(factory) :
    (global = typeof globalThis !== 'undefined' ? globalThis : global || self, global.flipTriangles = factory());
})(this, (function () { 'use strict';

    // Make a triangulated polygon cheaper to draw by flipping diagonals, on the same vertices.
    //
    // Two triangles that share an edge form a quadrilateral. If it is strictly convex, a flip replaces
    // the shared edge by the other diagonal. Then the triangles are put in a walk from neighbour to
    // neighbour. ORDER.md specifies the order of flips and the walk, so that this file,
    // flip_triangles.hpp and Python's triangulators.flip return the same triangles.

    const MAX_INTEGER = 2 ** 25; // integer coordinates up to this have exact orientations and lengths in doubles
    const MAX_EXACT = 1.6e8; // the in-circle test of integers is exact up to this sum of squared distances
    const UNDERFLOW_BOUND = 1e-300; // exceeds the underflow error of a product

    // Buffers that are reused by later calls and grow with the input.
    let origin = new Int32Array(0); // index of the point where a half-edge begins; three half-edges per triangle
    let twin = origin; // the opposite half-edge; negative if there is none
    let stack = origin; // half-edges to test
    let slots = origin; // hash table of half-edges by their end points, with open addressing
    let queued = new Uint8Array(0); // whether a half-edge is on the stack
    let entry = origin; // the half-edge over which the walk enters a triangle, FREE or ROOT
    let branchSize = origin; // triangles in the branch of a triangle
    let queue = origin; // triangles of a component, breadth first
    let walked = origin; // triangles in walk order
    let met = queued; // whether a vertex belongs to an earlier triangle of the walk
    const FREE = -2, ROOT = -1;

    const isNumberList = (list) => (Array.isArray(list) || ArrayBuffer.isView(list)) && (list.length === 0 || typeof list[0] === "number");
    const next = (e) => (e % 3 === 2 ? e - 2 : e + 1);
    const previous = (e) => (e % 3 === 0 ? e + 2 : e - 1);
    const isInteger = (...values) => values.every((v) => Math.abs(v) <= MAX_INTEGER && v === Math.floor(v));

    /**
     * Flip diagonals in place until no flip is an improvement; then put the triangles in a walk.
     *
     * @param {number[] | Uint16Array | Uint32Array | Int32Array} triangles three indices per triangle,
     *     in the same orientation, as from earcut
     * @param {ArrayLike<number>} vertices flat coordinates, as for earcut
     * @param {{dimensions?: number, by?: "l1" | "euclidean" | "delaunay", order?: "walk" | "native"}} [options]
     *     coordinates per vertex (2), of which the first two are used; the value that a flip must reduce:
     *     the length of the diagonal, |dx| + |dy| ("l1") or Euclidean, or the two angles opposite it
     *     ("delaunay"); order of the result: as by `reorder`, or "native", a flip's two triangles at the
     *     positions of the old two
     * @returns {number} number of flips
     * @throws {RangeError} if an index is out of range or an option is unknown
     * @throws {TypeError} if triangles or vertices is not a flat array of numbers
     */
    function flip(triangles, vertices, {dimensions = 2, by = "l1", order = "walk"} = {}) {
        const delaunay = by === "delaunay", l1 = by === "l1";
        if (!delaunay && !l1 && by !== "euclidean") {
            throw new RangeError(`flip: unknown by "${by}" (choose from l1, euclidean, delaunay)`);
        }
        if (order !== "walk" && order !== "native") {
            throw new RangeError(`flip: unknown order "${order}" (choose from walk, native)`);
        }
        if (!(dimensions >= 2 && dimensions === Math.floor(dimensions))) {
            throw new RangeError(`flip: dimensions must be an integer >= 2, not ${dimensions}`);
        }
        if (!isNumberList(triangles) || !isNumberList(vertices)) {
            throw new TypeError("flip: triangles and vertices must be flat arrays of numbers (three.js: attribute.array)");
        }
        const count = triangles.length - triangles.length % 3;
        let height = link(triangles, count, Math.floor(vertices.length / dimensions));
        let flips = 0;
        let orientation = 0; // of the first triangle that is not degenerate
        for (let e = 0; height && delaunay && !orientation && e < count; e += 3) {
            const a = origin[e] * dimensions, b = origin[e + 1] * dimensions, c = origin[e + 2] * dimensions;
            // The sign of NaN becomes 0.
            orientation = Math.sign((vertices[b] - vertices[a]) * (vertices[c + 1] - vertices[a + 1]) -
                (vertices[b + 1] - vertices[a + 1]) * (vertices[c] - vertices[a])) || 0;
        }

        while (height) {
            const e = stack[--height], f = twin[e];
            queued[e] = 0;
            if (f < 0) continue;

            // The diagonal b-c is shared by the triangles a, b, c of e and d, c, b of f.
            const e1 = next(e), e2 = previous(e), f1 = next(f), f2 = previous(f);
            const a = origin[e2], d = origin[f2];
            const i = a * dimensions, j = origin[e] * dimensions, k = origin[f] * dimensions, l = d * dimensions;
            const ax = vertices[i], ay = vertices[i + 1], bx = vertices[j], by = vertices[j + 1];
            const cx = vertices[k], cy = vertices[k + 1], dx = vertices[l], dy = vertices[l + 1];
            const x = dx - ax, y = dy - ay, u = cx - bx, v = cy - by;

            if (delaunay ? !inCircle(orientation, ax, ay, bx, by, cx, cy, dx, dy) :
                l1 ? !(Math.abs(x) + Math.abs(y) < Math.abs(u) + Math.abs(v)) :
                    !(x * x + y * y < u * u + v * v)) continue;

            // The new triangles a, b, d and a, d, c must have a certain orientation, and the same one.
            const p = (bx - ax) * y, q = (by - ay) * x, r = x * (cy - ay), s = y * (cx - ax);
            const turn1 = p - q, turn2 = r - s;
            if (!(turn1 > 0 ? turn2 > 0 : turn1 < 0 && turn2 < 0)) continue;
            if (!(Math.abs(turn1) > 4e-16 * (Math.abs(p) + Math.abs(q)) + UNDERFLOW_BOUND &&
                Math.abs(turn2) > 4e-16 * (Math.abs(r) + Math.abs(s)) + UNDERFLOW_BOUND ||
                isInteger(ax, ay, bx, by, cx, cy, dx, dy))) continue;

            flips++;
            origin[e] = d;
            origin[f] = a;
            const below = twin[f2], above = twin[e2];
            twin[e] = below;
            twin[f] = above;
            twin[e2] = f2;
            twin[f2] = e2;
            if (below >= 0) { twin[below] = e; if (!queued[e]) queued[stack[height++] = e] = 1; }
            if (above >= 0) { twin[above] = f; if (!queued[f]) queued[stack[height++] = f] = 1; }
            if (twin[e1] >= 0 && !queued[e1]) queued[stack[height++] = e1] = 1;
            if (twin[f1] >= 0 && !queued[f1]) queued[stack[height++] = f1] = 1;
        }
        if (order === "walk") walk(triangles, count);
        else for (let e = 0; e < count; e++) triangles[e] = origin[e];
        return flips;
    }

    /**
     * Put triangles in a walk from neighbour to neighbour, in place and in linear time, so that a GPU
     * transforms few vertices twice. Triangles are rotated, not mirrored.
     *
     * @param {number[] | Uint16Array | Uint32Array | Int32Array} triangles as for `flip`
     * @param {number} numberOfVertices all indices must be below it
     * @throws {RangeError} if an index is out of range
     * @throws {TypeError} if triangles is not a flat array of numbers
     */
    flip.reorder = function reorder(triangles, numberOfVertices) {
        if (!isNumberList(triangles)) throw new TypeError("reorder: triangles must be a flat array of numbers");
        const count = triangles.length - triangles.length % 3;
        link(triangles, count, numberOfVertices);
        walk(triangles, count);
    };

    /** Write the triangles of `origin` to `triangles` in walk order, given their twins. */
    function walk(triangles, count) {
        const m = count / 3;
        entry.fill(FREE, 0, m);
        branchSize.fill(1, 0, m);
        let done = 0, last = 0;
        for (let first = 0; first < m; first++) {
            if (entry[first] === FREE) done = walkComponent(findLeaf(first), done);
        }
        for (let e = 0; e < count; e++) last = Math.max(last, origin[e]);
        if (met.length <= last) met = new Uint8Array(last + 1);
        for (let e = 0; e < count; e++) met[origin[e]] = 0;
        for (let e = 0; e < count; e += 3) {
            const row = 3 * walked[e / 3];
            const a = origin[row], b = origin[row + 1], c = origin[row + 2];
            const shift = !met[c] ? 0 : !met[b] ? 2 : !met[a] ? 1 : 0; // the new vertex comes last
            triangles[e] = shift === 0 ? a : shift === 1 ? b : c;
            triangles[e + 1] = shift === 0 ? b : shift === 1 ? c : a;
            triangles[e + 2] = shift === 0 ? c : shift === 1 ? a : b;
            met[a] = met[b] = met[c] = 1;
        }
    }

    /** The half-edge over which a triangle is entered; the first one of the root. */
    const entryOf = (t) => (entry[t] < 0 ? 3 * t : entry[t]);
    const triangleOf = (e) => e / 3 | 0;

    /** Append the component of `root` to `walked`, from index `done` on; return the new end. */
    function walkComponent(root, done) {
        let tail = 1, height = 1;
        entry[root] = ROOT;
        queue[0] = root;
        for (let head = 0; head < tail; head++) {
            for (let k = 0, e = entryOf(queue[head]); k < 3; k++, e = next(e)) {
                const f = twin[e];
                if (f >= 0 && entry[triangleOf(f)] === FREE) {
                    entry[triangleOf(f)] = f;
                    queue[tail++] = triangleOf(f);
                }
            }
        }
        while (--tail > 0) branchSize[triangleOf(twin[entry[queue[tail]]])] += branchSize[queue[tail]]; // descendants come later
        stack[0] = root;
        while (height > 0) {
            const t = walked[done++] = stack[--height], begin = height;
            for (let k = 0, e = entryOf(t); k < 3; k++, e = next(e)) {
                const f = twin[e], branch = triangleOf(f);
                if (f < 0 || entry[branch] !== f) continue;
                let at = height++; // at most three branches: insertion sort, the smallest on top
                for (; at > begin && branchSize[stack[at - 1]] < branchSize[branch]; at--) stack[at] = stack[at - 1];
                stack[at] = branch;
            }
        }
        return done;
    }

    /** The first triangle with at most one neighbour, breadth first from `first`; otherwise `first`. */
    function findLeaf(first) {
        let tail = 1, leaf = -1;
        entry[queue[0] = first] = ROOT;
        for (let head = 0; head < tail && leaf < 0; head++) {
            let neighbours = 0;
            for (let e = 3 * queue[head], end = e + 3; e < end; e++) {
                if (twin[e] < 0) continue;
                neighbours++;
                const t = triangleOf(twin[e]);
                if (entry[t] === FREE) entry[queue[tail++] = t] = ROOT;
            }
            if (neighbours < 2) leaf = queue[head];
        }
        while (tail > 0) entry[queue[--tail]] = FREE;
        return leaf < 0 ? first : leaf;
    }

    /**
     * Link all half-edges with their twins and push one of each pair on the stack; return its size.
     *
     * Unlinked half-edges between the same two points have the same direction and form a circular list:
     * `twin` holds -2 - next, and the last one refers to the first. A slot of the hash table holds the
     * last one, so both ends of the list are found in constant time, for any number of equal edges.
     */
    function link(triangles, count, points) {
        let bits = 4;
        while (1 << bits < count + (count >> 1)) bits++;
        if (origin.length < count) {
            origin = new Int32Array(count);
            twin = new Int32Array(count);
            stack = new Int32Array(count);
            queued = new Uint8Array(count);
            [entry, branchSize, queue, walked] = Array.from({length: 4}, () => new Int32Array(count / 3));
        }
        if (slots.length < 1 << bits) slots = new Int32Array(1 << bits);
        const shift = 32 - bits, mask = (1 << bits) - 1;
        slots.fill(-1, 0, mask + 1);
        queued.fill(0, 0, count);

        let height = 0;
        for (let first = 0; first < count; first += 3) {
            const i = triangles[first], j = triangles[first + 1], k = triangles[first + 2];
            if (!(i >>> 0 === i && j >>> 0 === j && k >>> 0 === k && i < points && j < points && k < points)) {
                throw new RangeError(`flip: triangle ${first / 3} is ${[i, j, k]}: index out of range (0 to ${points - 1})`);
            }
            origin[first] = i;
            origin[first + 1] = j;
            origin[first + 2] = k;
            let tail = i;
            for (let e = first; e < first + 3; e++) {
                const head = e < first + 2 ? origin[e + 1] : i;
                const low = tail < head ? tail : head, high = tail < head ? head : tail;
                let slot = Math.imul(low + Math.imul(high, 0x9e3779b1), 0x85ebca6b) >>> shift;
                let last, against = false; // against: whether the unlinked half-edges run from head to tail
                for (; (last = slots[slot]) >= 0; slot = slot + 1 & mask) {
                    const start = origin[last];
                    if (start === head && origin[next(last)] === tail) {
                        against = true;
                        break;
                    }
                    if (start === tail && origin[next(last)] === head) break;
                }
                if (last < 0 || twin[last] >= 0) {
                    slots[slot] = e;
                    twin[e] = -2 - e;
                } else if (against) {
                    const oldest = -2 - twin[last];
                    if (oldest !== last) twin[last] = twin[oldest];
                    twin[oldest] = e;
                    twin[e] = oldest;
                    queued[stack[height++] = oldest] = 1;
                } else {
                    slots[slot] = e;
                    twin[e] = twin[last];
                    twin[last] = -2 - e;
                }
                tail = head;
            }
        }
        return height;
    }

    /** Whether d certainly lies inside the circle through a, b, c, counter-clockwise if orientation > 0. */
    function inCircle(orientation, ax, ay, bx, by, cx, cy, dx, dy) {
        const px = ax - dx, py = ay - dy, qx = bx - dx, qy = by - dy, rx = cx - dx, ry = cy - dy;
        const p = px * px + py * py, q = qx * qx + qy * qy, r = rx * rx + ry * ry;
        const a = qx * ry - qy * rx, b = rx * py - ry * px, c = px * qy - py * qx;
        const inside = (p * a + q * b + r * c) * orientation, size = p + q + r;
        if (Math.abs(inside) > 1e-15 * size * size + UNDERFLOW_BOUND) return inside > 0;
        if (size <= MAX_EXACT && inside === 0 || !isInteger(ax, ay, bx, by, cx, cy, dx, dy)) return false;
        if (size <= MAX_EXACT) return inside > 0;
        const exact = BigInt(p) * BigInt(a) + BigInt(q) * BigInt(b) + BigInt(r) * BigInt(c);
        return exact * BigInt(orientation) > 0n;
    }

    return flip;

}));
