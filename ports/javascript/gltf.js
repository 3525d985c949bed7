// Flips for glTF-Transform: the flat faces of a model get shorter diagonals, on the same vertices.
//
// A face is what triangles in one plane make, joined by edges with the same two indices. Another
// diagonal is not seen only where all that a vertex holds beside its place is linear over the face:
// its normal, its texture's coordinates, its colour, what moves it. Other faces stay as they are.

import flip from "./flip-triangles.js";

const FLAT = 1e-6; // of a primitive's extent: how far a corner may lie from its face's plane
const LINEAR = 1e-4; // of an attribute's largest value: how far it may lie from being linear

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];

/**
 * A transform for glTF-Transform's `document.transform`. Primitives without indices, and those that
 * are no lists of triangles, stay as they are: use glTF-Transform's `weld` before.
 *
 * @param {{by?: "l1" | "euclidean" | "delaunay"}} [options] what a flip must lessen: "euclidean"
 *     where it is left out, since a model is turned
 * @returns {(document: object) => void} says to the document's logger how many flips were made
 */
export default function retriangulate({by = "euclidean"} = {}) {
    return function retriangulate(document) {
        let flips = 0;
        for (const mesh of document.getRoot().listMeshes()) {
            for (const primitive of mesh.listPrimitives()) flips += flipPrimitive(primitive, by);
        }
        document.getLogger().info(`retriangulate: ${flips} flips`);
    };
}

function flipPrimitive(primitive, by) {
    const indices = primitive.getIndices(), position = primitive.getAttribute("POSITION");
    if (primitive.getMode() !== 4 || !indices || !position) return 0; // 4: TRIANGLES
    const points = Array.from({length: position.getCount()}, (_, i) => position.getElement(i, []));
    const extent = Math.max(...[0, 1, 2].map((k) => points.reduce((m, p) => Math.max(m, p[k]), -Infinity) -
        points.reduce((m, p) => Math.min(m, p[k]), Infinity)));
    const others = [primitive, ...primitive.listTargets()].flatMap((each) => each.listAttributes()).filter((a) => a !== position);
    const corners = Array.from(indices.getArray());
    let flips = 0;
    for (const {face, plane} of faces(corners, points, FLAT * extent)) {
        if (others.every((attribute) => isLinear(attribute, face, plane, corners, points))) {
            flips += flipFace(face, plane, corners, points, by);
        }
    }
    if (flips) {
        const own = indices.clone().setArray(new (indices.getArray().constructor)(corners)); // others may share it
        primitive.setIndices(own);
        if (indices.listParents().length === 1) indices.dispose(); // the document alone
    }
    return flips;
}

/** Corner, two sides and unit normal of a triangle; the normal is not finite where it has no area. */
function planeOf(t, corners, points) {
    const [a, b, c] = [0, 1, 2].map((k) => points[corners[3 * t + k]]);
    const u = minus(b, a), v = minus(c, a), n = cross(u, v);
    return {a, u, v, area: Math.hypot(...n), normal: scaled(n, 1 / Math.hypot(...n))};
}

/** Faces of two triangles or more, the largest first, with the plane of that one. */
function faces(corners, points, most) {
    const count = Math.floor(corners.length / 3), planes = Array.from({length: count}, (_, t) => planeOf(t, corners, points));
    const across = new Map(); // from an edge, as it is wound, to its triangle; null where it has several
    const edge = (t, k) => `${corners[3 * t + k]},${corners[3 * t + (k + 1) % 3]}`;
    const back = (t, k) => `${corners[3 * t + (k + 1) % 3]},${corners[3 * t + k]}`;
    for (let i = 0; i < 3 * count; ++i) {
        const key = edge(Math.floor(i / 3), i % 3);
        across.set(key, across.has(key) ? null : Math.floor(i / 3));
    }
    const taken = new Uint8Array(count), found = [];
    const order = planes.map((_, t) => t).filter((t) => planes[t].area > 0).sort((s, t) => planes[t].area - planes[s].area);
    for (const first of order) {
        if (taken[first]) continue;
        taken[first] = 1;
        const face = [first], {a, normal} = planes[first];
        for (let at = 0; at < face.length; ++at) { // what is in the face lies in its first one's plane
            for (let k = 0; k < 3; ++k) {
                const t = across.get(back(face[at], k));
                if (t == null || taken[t] || !(planes[t].area > 0) || dot(planes[t].normal, normal) <= 0) continue;
                if ([0, 1, 2].some((j) => Math.abs(dot(minus(points[corners[3 * t + j]], a), normal)) > most)) continue;
                taken[t] = 1;
                face.push(t);
            }
        }
        if (face.length > 1) found.push({face, plane: planes[first]});
    }
    return found;
}

const verticesOf = (face, corners) => [...new Set(face.flatMap((t) => [0, 1, 2].map((k) => corners[3 * t + k])))];

/** Whether an attribute is, at each vertex of a face, what its first triangle's corners make of it. */
function isLinear(attribute, face, {a, u, v}, corners, points) {
    const [at, on, to] = [0, 1, 2].map((k) => attribute.getElement(corners[3 * face[0] + k], []));
    const uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), all = uu * vv - uv * uv;
    return verticesOf(face, corners).every((i) => {
        const p = minus(points[i], a), pu = dot(p, u), pv = dot(p, v);
        const s = (vv * pu - uv * pv) / all, t = (uu * pv - uv * pu) / all;
        return attribute.getElement(i, []).every((value, k) => {
            const made = at[k] + s * (on[k] - at[k]) + t * (to[k] - at[k]);
            return Math.abs(value - made) <= LINEAR * Math.max(Math.abs(value), Math.abs(at[k]), Math.abs(on[k]), Math.abs(to[k]));
        });
    });
}

/** Flip a face's triangles, seen along its normal, and write them back in their places. */
function flipFace(face, {a, u, normal}, corners, points, by) {
    const right = scaled(u, 1 / Math.hypot(...u)), up = cross(normal, right);
    const vertices = verticesOf(face, corners), place = new Map(vertices.map((i, local) => [i, local]));
    const flat = vertices.flatMap((i) => [dot(minus(points[i], a), right), dot(minus(points[i], a), up)]);
    const triangles = face.flatMap((t) => [0, 1, 2].map((k) => place.get(corners[3 * t + k])));
    const flips = flip(triangles, flat, {by});
    face.forEach((t, n) => [0, 1, 2].forEach((k) => (corners[3 * t + k] = vertices[triangles[3 * n + k]])));
    return flips;
}
