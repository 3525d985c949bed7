(function (global, factory) {
    typeof exports === 'object' && typeof module !== 'undefined' ? module.exports = factory() :
    typeof define === 'function' && define.amd ? define(factory) :
    (global = typeof globalThis !== 'undefined' ? globalThis : global || self, global.flipTriangles = factory());
})(this, (function () { 'use strict';

    // Make a triangulated polygon cheaper to draw by flipping diagonals, on the same vertices.
    //
    // Two triangles that share an edge form a quadrilateral. If it is strictly convex, a flip replaces
    // the shared edge by the other diagonal. Then the triangles are put in a walk from neighbour to
    // neighbour. ORDER.md specifies the tests, the order of flips and the walk, so that this file,
    // flip_triangles.hpp and Python's triangulators.flip return the same triangles.

    const {abs, floor, max, min, sign} = Math;
    const MAX_INTEGER = 2 ** 25; // integer coordinates up to this have exact orientations and lengths in doubles
    const MAX_EXACT = 1.6e8; // the in-circle test of integers is exact up to this sum of squared distances
    const UNDERFLOW_BOUND = 1e-300; // exceeds the underflow error of a product
    const FREE = -2, ROOT = -1;

    // Typed arrays that are reused by later calls and grow with the input.
    let slots = []; // hash table of half-edges by their end points, with open addressing
    let quads = slots; // expected quads of a triangle
    let queued = slots; // whether a half-edge is on the stack
    let met = slots; // whether a vertex belongs to an earlier triangle of the walk
    let origin = slots; // index of the point where a half-edge begins; three half-edges per triangle
    let twin = slots; // the opposite half-edge; negative if there is none
    let stack = slots; // half-edges to test
    let height = 0; // of the stack
    let coordinates = slots, stride = 2; // of the vertices in a call
    let entry = slots; // the half-edge over which the walk enters a triangle, FREE or ROOT
    let branchSize = slots; // triangles in the branch of a triangle
    let queue = slots; // triangles of a component, breadth first
    let walked = slots; // triangles in walk order

    const fail = (message) => { throw new RangeError("flip: " + message); };
    const checkLists = (...lists) => lists.forEach((list) => {
        if (!((Array.isArray(list) || ArrayBuffer.isView(list)) && (list.length === 0 || typeof list[0] === "number"))) {
            throw new TypeError("flip: triangles and vertices must be flat arrays of numbers (three.js: attribute.array)");
        }
    });
    const next = (e) => (e % 3 === 2 ? e - 2 : e + 1);
    const previous = (e) => (e % 3 === 0 ? e + 2 : e - 1);
    const triangleOf = (e) => e / 3 | 0;
    const x = (i) => coordinates[i * stride], y = (i) => coordinates[i * stride + 1];
    const areIntegers = (...vertices) => vertices.every((i) => [x(i), y(i)].every((v) => abs(v) <= MAX_INTEGER && v === floor(v)));

    /**
     * Flip diagonals in place until no flip is an improvement; then put the triangles in a walk.
     *
     * @param {number[] | Uint16Array | Uint32Array | Int32Array} triangles three indices per triangle,
     *     in the same orientation, as from earcut
     * @param {ArrayLike<number>} vertices flat coordinates, as for earcut
     * @param {{dimensions?: number, by?: "l1" | "euclidean" | "delaunay" | "quads", scale?: number,
     *     order?: "walk" | "native"}} [options]
     *     coordinates per vertex (2), of which the first two are used; the value that a flip must reduce:
     *     the length of the diagonal, |dx| + |dy| ("l1") or Euclidean, the two angles opposite it
     *     ("delaunay"), or the expected number of 2x2 pixel quads ("quads"), for which `scale` is the
     *     number of pixels per unit; order of the result: as by `reorder`, or "native", a flip's two
     *     triangles at the positions of the old two
     * @returns {number} number of flips
     * @throws {RangeError} if an index is out of range or an option is unknown
     * @throws {TypeError} if triangles or vertices is not a flat array of numbers
     */
    function flip(triangles, vertices, {dimensions = 2, by = "l1", order = "walk", scale} = {}) {
        checkChoice("by", by, ["l1", "euclidean", "delaunay", "quads"]);
        checkChoice("order", order, ["walk", "native"]);
        if (by === "quads" && !(scale > 0 && scale < Infinity)) {
            fail(`by "quads" needs scale, pixels per unit (map tile: px / extent; font: px / units per em), not ${scale}`);
        }
        if (!(dimensions >= 2 && dimensions === floor(dimensions))) fail(`dimensions must be an integer >= 2, not ${dimensions}`);
        checkLists(triangles, vertices);
        const count = triangles.length - triangles.length % 3;
        link(triangles, count, floor(vertices.length / dimensions));
        coordinates = vertices;
        stride = dimensions;
        const flips = flipAll(count, by, by === "quads" ? scale : 0);
        coordinates = slots; // no reference to the vertices is left
        if (order === "walk") walk(triangles, count);
        else for (let e = 0; e < count; e++) triangles[e] = origin[e];
        return flips;
    }

    function checkChoice(option, value, values) {
        if (!values.includes(value)) fail(`unknown ${option} "${value}" (choose from ${values.join(", ")})`);
    }

    /** Flip until no flip is an improvement; return the number of flips. */
    function flipAll(count, by, scale) {
        const isLess = (after, before) => after < before - 1e-12 * (before + after); // by more than rounding errors
        let flips = 0;
        let orientation = 0; // of the first triangle that is not degenerate
        for (let e = 0; e < count; e += 3) {
            const a = origin[e], b = origin[e + 1], c = origin[e + 2];
            if (scale) quads[e / 3] = expectedQuads(a, b, c, scale);
            // The sign of NaN becomes 0.
            orientation ||= sign((x(b) - x(a)) * (y(c) - y(a)) - (y(b) - y(a)) * (x(c) - x(a))) || 0;
        }
        while (height) {
            const e = stack[--height], f = twin[e];
            queued[e] = 0;
            if (f < 0) continue;
            // The diagonal b-c is shared by the triangles a, b, c of e and d, c, b of f.
            const e2 = previous(e), f2 = previous(f), a = origin[e2], b = origin[e], c = origin[f], d = origin[f2];
            const p = x(d) - x(a), q = y(d) - y(a), r = x(c) - x(b), s = y(c) - y(b);
            if (!(by === "l1" ? abs(p) + abs(q) < abs(r) + abs(s) :
                by === "euclidean" ? p * p + q * q < r * r + s * s :
                    scale || inCircle(orientation, a, b, c, d)) || !isConvex(a, b, c, d)) continue;
            const before = quads[triangleOf(e)] + quads[triangleOf(f)];
            const lower = scale && expectedQuads(a, b, d, scale), upper = scale && expectedQuads(a, d, c, scale); // of f and e after the flip
            let gain = 0, side = -1, first, second;
            if (!scale || isLess(lower + upper, before)) gain = 1;
            else for (let k = 0; k < 4; k++) {
                // Each side of the quadrilateral: its half-edge before the flip, with the twin g.
                const s = k < 1 ? f2 : k < 2 ? e2 : next(k < 3 ? e : f), g = twin[s];
                if (g < 0) continue;
                const third = k % 3 ? d : a, tail = origin[s], head = origin[g], apex = origin[previous(g)];
                if (!isConvex(third, tail, head, apex)) continue;
                const left = expectedQuads(third, tail, apex, scale), right = expectedQuads(third, apex, head, scale);
                const total = before + quads[triangleOf(g)], after = (k % 2 ? upper : lower) + left + right;
                if (isLess(after, total) && total - after > gain) {
                    gain = total - after;
                    side = k < 1 ? e : k < 2 ? f : s; // its half-edge after the flip
                    first = left;
                    second = right;
                }
            }
            if (gain) flips += flipEdge(e, lower, upper);
            if (side >= 0) flips += flipEdge(side, first, second);
        }
        return flips;
    }

    /** Whether the triangles a, b, d and a, d, c certainly have the same nonzero orientation. */
    function isConvex(a, b, c, d) {
        const ax = x(a), ay = y(a), dx = x(d) - ax, dy = y(d) - ay;
        const p = (x(b) - ax) * dy, q = (y(b) - ay) * dx, r = dx * (y(c) - ay), s = dy * (x(c) - ax);
        const turn1 = p - q, turn2 = r - s;
        return (turn1 > 0 ? turn2 > 0 : turn1 < 0 && turn2 < 0) &&
            (abs(turn1) > 4e-16 * (abs(p) + abs(q)) + UNDERFLOW_BOUND &&
            abs(turn2) > 4e-16 * (abs(r) + abs(s)) + UNDERFLOW_BOUND || areIntegers(a, b, c, d));
    }

    /** Replace the diagonal of a half-edge, push the sides of its quadrilateral, and return 1; lower, upper: expected quads. */
    function flipEdge(e, lower, upper) {
        const f = twin[e], e2 = previous(e), f2 = previous(f), below = twin[f2], above = twin[e2], d = origin[f2];
        quads[triangleOf(f)] = lower;
        quads[triangleOf(e)] = upper;
        origin[f] = origin[e2];
        origin[e] = d;
        twin[e] = below;
        twin[f] = above;
        twin[e2] = f2;
        twin[f2] = e2;
        if (below >= 0) twin[below] = e;
        if (above >= 0) twin[above] = f;
        push(e);
        push(f);
        push(next(e));
        push(next(f));
        return 1;
    }

    function push(e) {
        if (twin[e] >= 0 && !queued[e]) queued[stack[height++] = e] = 1;
    }

    /** The mean number of 2x2 pixel quads with a pixel centre in a triangle, over all positions on the pixel grid. */
    function expectedQuads(a, b, c, scale) {
        const ax = x(a) * scale, ay = y(a) * scale, bx = x(b) * scale, by = y(b) * scale, cx = x(c) * scale, cy = y(c) * scale;
        const ux = bx - ax, uy = by - ay, vx = cx - bx, vy = cy - by, wx = ax - cx, wy = ay - cy;
        const cross = ux * vy - uy * vx, s = cross < 0 ? -1 : 1;
        const common = (lost, side = max(0, 1 - lost / (cross * s))) => side * side;
        const extent = (i, j, k) => max(i, j, k) - min(i, j, k);
        const triple = (r, u) => common(-(min(0, r * uy, u * ux) + min(0, r * vy, u * vx)) - min(0, r * wy, u * wx));
        const width = extent(ax, bx, cx), tall = extent(ay, by, cy);
        const pairs = common(width) + common(tall);
        const diagonals = common(extent(ax - ay, bx - by, cx - cy)) + common(extent(ax + ay, bx + by, cx + cy));
        const triples = triple(-s, -s) + triple(-s, s) + triple(s, -s) + triple(s, s);
        return cross && 0.5 * cross * s * (4 - 2 * pairs + (triples - diagonals - common(width + tall))) / 4;
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
        checkLists(triangles);
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
        for (let e = 0; e < count; e++) last = max(last, origin[e]);
        if (met.length <= last) met = new Uint8Array(last + 1);
        for (let e = 0; e < count; e++) met[origin[e]] = 0;
        for (let e = 0; e < count; e += 3) {
            const row = 3 * walked[e / 3], a = origin[row], b = origin[row + 1], c = origin[row + 2];
            const shift = !met[c] ? 0 : !met[b] ? 2 : !met[a] ? 1 : 0; // the new vertex comes last
            for (let k = 0; k < 3; k++) triangles[e + k] = origin[row + (k + shift) % 3];
            met[a] = met[b] = met[c] = 1;
        }
    }

    /** The half-edge over which a triangle is entered; the first one of the root. */
    const entryOf = (t) => (entry[t] < 0 ? 3 * t : entry[t]);

    /** Append the component of `root` to `walked`, from index `done` on; return the new end. */
    function walkComponent(root, done) {
        let tail = 1;
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
        height = 1;
        while (height) {
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
     * Link all half-edges with their twins and push one of each pair on the stack.
     *
     * Unlinked half-edges between the same two points have the same direction and form a circular list:
     * `twin` holds -2 - next, and the last one refers to the first. A slot of the hash table holds the
     * last one, so both ends of the list are found in constant time, for any number of equal edges.
     */
    function link(triangles, count, n) {
        let bits = 4;
        while (1 << bits < count + (count >> 1)) bits++;
        if (origin.length < count) {
            [origin, twin, stack, entry, branchSize, queue, walked] = Array.from({length: 7}, () => new Int32Array(count));
            queued = new Uint8Array(count);
            quads = new Float64Array(count);
        }
        if (slots.length < 1 << bits) slots = new Int32Array(1 << bits);
        const shift = 32 - bits, mask = (1 << bits) - 1;
        slots.fill(-1, 0, mask + 1);
        queued.fill(0, 0, count);
        for (let e = 0; e < count; e++) {
            const index = triangles[e];
            if (index >>> 0 !== index || index >= n) fail(`triangle ${triangleOf(e)} has index ${index}: out of range (0 to ${n - 1})`);
            origin[e] = index;
        }
        height = 0;
        for (let e = 0; e < count; e++) {
            const tail = origin[e], head = origin[next(e)], low = min(tail, head), high = max(tail, head);
            let slot = Math.imul(low + Math.imul(high, 0x9e3779b1), 0x85ebca6b) >>> shift;
            let last, against = false; // against: whether the unlinked half-edges run from head to tail
            for (; (last = slots[slot]) >= 0; slot = slot + 1 & mask) {
                const start = origin[last], end = origin[next(last)];
                against = start === head && end === tail;
                if (against || start === tail && end === head) break;
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
        }
    }

    /** Whether d certainly lies inside the circle through a, b, c, counter-clockwise if orientation > 0. */
    function inCircle(orientation, a, b, c, d) {
        const dx = x(d), dy = y(d), px = x(a) - dx, py = y(a) - dy, qx = x(b) - dx, qy = y(b) - dy, rx = x(c) - dx, ry = y(c) - dy;
        const p = px * px + py * py, q = qx * qx + qy * qy, r = rx * rx + ry * ry;
        const i = qx * ry - qy * rx, j = rx * py - ry * px, k = px * qy - py * qx;
        const inside = (p * i + q * j + r * k) * orientation, size = p + q + r;
        if (abs(inside) > 1e-15 * size * size + UNDERFLOW_BOUND) return inside > 0;
        if (size <= MAX_EXACT && inside === 0 || !areIntegers(a, b, c, d)) return false;
        if (size <= MAX_EXACT) return inside > 0;
        const exact = BigInt(p) * BigInt(i) + BigInt(q) * BigInt(j) + BigInt(r) * BigInt(k);
        return exact * BigInt(orientation) > 0n;
    }

    return flip;

}));
