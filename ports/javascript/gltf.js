// Flips for glTF-Transform: shorter diagonals of the flat faces of a model, on the same vertices.
//
// A face is a set of coplanar triangles that are connected by edges with the same two indices. A flip
// is invisible only if all other attributes of the vertices are linear over the face: normals, texture
// coordinates, colours, morph targets. Faces with other attributes are not changed.

import flip from "./flip-triangles.js";

const FLAT = 1e-6; // max distance of a vertex from the plane of its face, relative to the primitive's extent
const LINEAR = 1e-4; // max deviation of an attribute from a linear one, relative to its largest value

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];

/**
 * Return a transform for glTF-Transform's `document.transform`. Primitives without indices or with a
 * mode other than TRIANGLES are not changed; apply glTF-Transform's `weld` first.
 *
 * @param {{by?: "l1" | "euclidean" | "delaunay"}} [options] the value that a flip must reduce;
 *     "euclidean" by default, because models rotate
 * @returns {(document: object) => void} the transform, which logs the number of flips
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
    const finite = points.filter((p) => p.every(Number.isFinite));
    const extent = Math.max(...[0, 1, 2].map((k) => finite.reduce((m, p) => Math.max(m, p[k]), -Infinity) -
        finite.reduce((m, p) => Math.min(m, p[k]), Infinity)));
    const attributes = [primitive, ...primitive.listTargets()].flatMap((owner) => owner.listAttributes()).filter((a) => a !== position);
    const triangles = Array.from(indices.getArray());
    let flips = 0;
    for (const {face, plane} of findFaces(triangles, points, FLAT * extent)) {
        if (attributes.every((attribute) => isLinear(attribute, face, plane, triangles, points))) {
            flips += flipFace(face, plane, triangles, points, by);
        }
    }
    if (flips) {
        const copy = indices.clone().setArray(new (indices.getArray().constructor)(triangles)); // another primitive may share the indices
        primitive.setIndices(copy);
        if (indices.listParents().length === 1) indices.dispose(); // used by the root of the document only
    }
    return flips;
}

/** Vertex, two sides, area and unit normal of a triangle; the normal of a zero area is not finite. */
function planeOf(t, triangles, points) {
    const [a, b, c] = [0, 1, 2].map((k) => points[triangles[3 * t + k]]);
    const u = minus(b, a), v = minus(c, a), n = cross(u, v);
    return {a, u, v, area: Math.hypot(...n), normal: scaled(n, 1 / Math.hypot(...n))};
}

/** Faces of at least two triangles; each begins with its largest triangle, which defines the plane. */
function findFaces(triangles, points, tolerance) {
    const count = Math.floor(triangles.length / 3), planes = Array.from({length: count}, (_, t) => planeOf(t, triangles, points));
    const triangleOf = new Map(); // directed edge -> triangle; null if there are several
    const edge = (t, k) => `${triangles[3 * t + k]},${triangles[3 * t + (k + 1) % 3]}`;
    const reversed = (t, k) => `${triangles[3 * t + (k + 1) % 3]},${triangles[3 * t + k]}`;
    for (let i = 0; i < 3 * count; ++i) {
        const key = edge(Math.floor(i / 3), i % 3);
        triangleOf.set(key, triangleOf.has(key) ? null : Math.floor(i / 3));
    }
    const assigned = new Uint8Array(count), result = [];
    const order = planes.map((_, t) => t).filter((t) => planes[t].area > 0).sort((s, t) => planes[t].area - planes[s].area);
    for (const first of order) {
        if (assigned[first]) continue;
        assigned[first] = 1;
        const face = [first], {a, normal} = planes[first];
        for (let at = 0; at < face.length; ++at) { // breadth-first search over edges in the plane
            for (let k = 0; k < 3; ++k) {
                const t = triangleOf.get(reversed(face[at], k));
                if (t == null || assigned[t] || !(planes[t].area > 0) || dot(planes[t].normal, normal) <= 0) continue;
                if (![0, 1, 2].every((j) => Math.abs(dot(minus(points[triangles[3 * t + j]], a), normal)) <= tolerance)) continue;
                assigned[t] = 1;
                face.push(t);
            }
        }
        if (face.length > 1) result.push({face, plane: planes[first]});
    }
    return result;
}

const verticesOf = (face, triangles) => [...new Set(face.flatMap((t) => [0, 1, 2].map((k) => triangles[3 * t + k])))];

/** Whether an attribute is linear over a face, extrapolated from the first triangle. */
function isLinear(attribute, face, {a, u, v}, triangles, points) {
    const [at, on, to] = [0, 1, 2].map((k) => attribute.getElement(triangles[3 * face[0] + k], []));
    const uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), determinant = uu * vv - uv * uv;
    return verticesOf(face, triangles).every((i) => {
        const p = minus(points[i], a), pu = dot(p, u), pv = dot(p, v);
        const s = (vv * pu - uv * pv) / determinant, t = (uu * pv - uv * pu) / determinant;
        return attribute.getElement(i, []).every((value, k) => {
            const expected = at[k] + s * (on[k] - at[k]) + t * (to[k] - at[k]);
            return Math.abs(value - expected) <= LINEAR * Math.max(Math.abs(value), Math.abs(at[k]), Math.abs(on[k]), Math.abs(to[k]));
        });
    });
}

/** Flip diagonals of a face in its plane and write the result to `triangles`. */
function flipFace(face, {a, u, normal}, triangles, points, by) {
    const right = scaled(u, 1 / Math.hypot(...u)), up = cross(normal, right);
    const vertices = verticesOf(face, triangles), localIndex = new Map(vertices.map((i, local) => [i, local]));
    const flat = vertices.flatMap((i) => [dot(minus(points[i], a), right), dot(minus(points[i], a), up)]);
    const localTriangles = face.flatMap((t) => [0, 1, 2].map((k) => localIndex.get(triangles[3 * t + k])));
    const flips = flip(localTriangles, flat, {by, order: "native"}); // a model keeps its order
    face.forEach((t, n) => [0, 1, 2].forEach((k) => (triangles[3 * t + k] = vertices[localTriangles[3 * n + k]])));
    return flips;
}
