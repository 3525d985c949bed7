// Test of retriangulate: the same vertices and area, and no visible change.

import assert from "node:assert/strict";
import {it} from "node:test";
import {Document, Logger} from "@gltf-transform/core";
import earcut from "earcut";
import retriangulate from "flip-triangles/gltf";

const tilt = ([x, y]) => [0.6 * x - 0.8 * y + 3, 0.48 * x + 0.36 * y - 0.8, 0.64 * x + 0.48 * y + 0.6]; // into an inclined plane
const outline = Array.from({length: 40}, (_, i) => {
    const r = i % 2 ? 9 : 7.2, angle = i / 40 * 2 * Math.PI;
    return [r * Math.cos(angle), r * Math.sin(angle)];
});

/** A document with one primitive: the outline in space, triangulated by earcut, with more attributes. */
function makeModel(attributes = {}, position = tilt, indexed = true) {
    const document = new Document().setLogger(new Logger(Logger.Verbosity.SILENT));
    const buffer = document.createBuffer();
    const accessor = (type, array) => document.createAccessor().setType(type).setArray(array).setBuffer(buffer);
    const primitive = document.createPrimitive().setAttribute("POSITION", accessor("VEC3", new Float32Array(outline.flatMap(position))));
    if (indexed) primitive.setIndices(accessor("SCALAR", new Uint16Array(earcut(outline.flat()))));
    for (const [name, [type, values]] of Object.entries(attributes)) {
        primitive.setAttribute(name, accessor(type, new Float32Array(outline.flatMap(values))));
    }
    document.createMesh().addPrimitive(primitive);
    return {document, primitive};
}

const cornersOf = (primitive) => Array.from(primitive.getIndices().getArray());
function measure(primitive) {
    const points = primitive.getAttribute("POSITION"), corners = cornersOf(primitive);
    let area = 0, length = 0;
    for (let t = 0; t < corners.length; t += 3) {
        const [a, b, c] = [0, 1, 2].map((k) => points.getElement(corners[t + k], []));
        const [u, v] = [b, c].map((p) => p.map((value, k) => value - a[k]));
        area += Math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
        length += [[a, b], [b, c], [c, a]].reduce((sum, [p, q]) => sum + Math.hypot(...p.map((value, k) => value - q[k])), 0);
    }
    return {area, length, count: corners.length};
}

const normal = ["VEC3", () => [0, -0.8, 0.6]], texture = ["VEC2", ([x, y]) => [0.1 * x + 0.02 * y + 0.5, 0.3 - 0.05 * y]];

it("flips a flat face on the same vertices", async () => {
    const {document, primitive} = makeModel({NORMAL: normal, TEXCOORD_0: texture}), before = measure(primitive);
    await document.transform(retriangulate());
    const after = measure(primitive);
    assert.equal(after.count, before.count);
    assert(Math.abs(after.area - before.area) < 1e-4 * before.area);
    assert(after.length < 0.9 * before.length);
    assert(primitive.getIndices().getArray() instanceof Uint16Array);
    assert.deepEqual([...new Set(cornersOf(primitive))].sort((a, b) => a - b), outline.map((_, i) => i));
    assert.equal(document.getRoot().listAccessors().length, 4); // the old indices are removed
});

for (const [name, attributes, position] of [
    ["a texture that is not linear", {TEXCOORD_0: ["VEC2", ([x, y]) => [x * x, y]]}],
    ["normals of a round surface", {NORMAL: ["VEC3", ([x, y]) => [x / 20, y / 20, 1]], COLOR_0: ["VEC3", ([x, y]) => [x * y, 0, 0]]}],
    ["a surface that is not flat", {}, ([x, y]) => [x, y, 0.01 * x * x + 0.007 * y * y * y]],
    ["a surface with a NaN", {}, ([x, y]) => [x, y, y === 0 ? NaN : 0.01 * x * x + 0.007 * y * y * y]],
]) {
    it(`does not change ${name}`, async () => {
        const {document, primitive} = makeModel(attributes, position), before = cornersOf(primitive);
        await document.transform(retriangulate());
        assert.deepEqual(cornersOf(primitive), before);
    });
}

it("retains shared indices, morph targets and unindexed primitives", async () => {
    const {document, primitive} = makeModel();
    const shared = primitive.getIndices(), before = cornersOf(primitive);
    const bentPrimitive = document.createPrimitive().setAttribute("POSITION", primitive.getAttribute("POSITION")).setIndices(shared);
    const targetPositions = document.createAccessor().setType("VEC3").setArray(new Float32Array(outline.flatMap(([x, y]) => [0, 0, x * y])));
    bentPrimitive.addTarget(document.createPrimitiveTarget().setAttribute("POSITION", targetPositions));
    document.getRoot().listMeshes()[0].addPrimitive(bentPrimitive);
    await document.transform(retriangulate({by: "delaunay"}));
    assert.notDeepEqual(cornersOf(primitive), before);
    assert.deepEqual(cornersOf(bentPrimitive), before);
    const unindexed = makeModel({}, tilt, false);
    await unindexed.document.transform(retriangulate());
    assert.equal(unindexed.primitive.getIndices(), null);
});

it("does not merge faces across a fold", async () => {
    const {document, primitive} = makeModel({}, ([x, y]) => [x, y, Math.max(0, x)]), before = measure(primitive);
    await document.transform(retriangulate());
    const after = measure(primitive);
    assert(Math.abs(after.area - before.area) < 1e-4 * before.area);
    assert(after.length <= before.length);
});
