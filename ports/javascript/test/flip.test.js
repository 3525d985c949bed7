// Tests of flip: results equal to Python's, rejection of bad input, and linear time for equal edges.

import assert from "node:assert/strict";
import {readFileSync} from "node:fs";
import {createRequire} from "node:module";
import {describe, it} from "node:test";
import earcut from "earcut";
import flip from "flip-triangles";

const lines = readFileSync(new URL("../../vectors.txt", import.meta.url), "utf8").trimEnd().split("\n");
const parse = (line) => line.split(" ").map(Number);
const square = [0, 0, 9, 0, 9, 1, 0, 1];

describe("triangles equal to Python's", () => {
    for (let start = 0; start < lines.length; start += 12) {
        const vertices = parse(lines[start]), before = parse(lines[start + 1]);
        for (let row = start + 2; row < start + 12; row += 2) {
            const [name, count] = lines[row].split(" "), [by, scale] = name.split("@"), after = parse(lines[row + 1]);
            it(`polygon ${start / 12}, ${by}`, () => {
                const triangles = before.slice();
                if (by === "reorder") {
                    flip.reorder(triangles, vertices.length / 2);
                    assert.deepEqual(triangles, after);
                    return;
                }
                assert.equal(flip(triangles, vertices, {by, scale: Number(scale)}), Number(count));
                assert.deepEqual(triangles, after);
                const typed = Uint16Array.from(before);
                flip(typed, Float64Array.from(vertices), {by, scale: Number(scale)});
                assert.deepEqual([...typed], after);
            });
        }
    }
});

describe("input", () => {
    it("may have three coordinates per vertex with dimensions: 3", () => {
        const vertices = [0, 0, NaN, 4, -1, NaN, 9, 0, NaN, 4, 1, NaN], triangles = [0, 1, 2, 0, 2, 3];
        assert.equal(flip(triangles, vertices, {dimensions: 3}), 1);
        const flat = [0, 1, 2, 0, 2, 3];
        flip(flat, [0, 0, 4, -1, 9, 0, 4, 1]);
        assert.deepEqual(triangles, flat);
        assert.notDeepEqual(triangles, [0, 1, 2, 0, 2, 3]);
    });
    it("is not changed if an index is out of range", () => {
        for (const bad of [-1, 4, 1.5, NaN, undefined, "1", 2147483648, 4294967296, Infinity]) {
            for (const position of [3, 4, 5]) {
                const triangles = [0, 1, 2, 0, 2, 3].map((index, k) => k === position ? bad : index), before = triangles.slice();
                assert.throws(() => flip(triangles, square), {name: "RangeError", message: /triangle 1 has index .*0 to 3/});
                assert.deepEqual(triangles, before);
            }
        }
    });
    it("is refused with bad dimensions, an unknown test or no flat arrays", () => {
        for (const dimensions of [0, 1, -2, 2.5, NaN, "2", null]) {
            assert.throws(() => flip([0, 1, 2], square, {dimensions}), {name: "RangeError", message: /dimensions/});
        }
        assert.throws(() => flip([0, 1, 2], square, {by: "L1"}), RangeError);
        for (const scale of [undefined, null, 0, -1, NaN, Infinity]) {
            const options = {by: "quads", scale};
            assert.throws(() => flip([0, 1, 2], square, options), {name: "RangeError", message: /needs scale, pixels per unit/});
        }
        assert.throws(() => flip([0, 1, 2], square, {order: "best"}), {name: "RangeError", message: /walk, native/});
        assert.throws(() => flip.reorder([0, 1, 4], 4), {name: "RangeError", message: /0 to 3/});
        assert.throws(() => flip.reorder([[0, 1, 2]], 3), {name: "TypeError", message: /flat array/});
        for (const bad of [null, undefined, 3, {length: 3}, "012", [[0, 0], [1, 0]], new BigInt64Array(8), new DataView(new ArrayBuffer(8))]) {
            assert.throws(() => flip([0, 1, 2], bad), {name: "TypeError", message: /flat arrays/});
            assert.throws(() => flip(bad, square), {name: "TypeError", message: /flat arrays/});
        }
    });
    it("may be empty or end within a triangle", () => {
        assert.equal(flip([], []), 0);
        assert.equal(flip([0, 1, 2, 0], square), 0);
    });
    it("may have NaN coordinates; no diagonal there is flipped", () => {
        // The only triangle that is not degenerate has a NaN; the integer points are collinear.
        const line = [0, 0, 33554432, 0, -33554432, 0, 1, 0, NaN, 0, 0, 1];
        for (const by of ["l1", "euclidean", "delaunay", "quads"]) {
            assert.equal(flip([0, 1, 2, 0, 2, 3, 3, 4, 5], line, {by, scale: 1}), 0);
        }
    });
    it("may have many equal edges, in linear time", () => {
        const time = (triangles) => {
            const start = process.cpuUsage().user;
            flip(triangles, square);
            return process.cpuUsage().user - start;
        };
        // Quadratic time would be 15 s of CPU time, linear time some hundredths.
        for (const triangle of [[0, 0, 0], [0, 1, 2]]) {
            const triangles = Uint32Array.from({length: 180000}, (_, i) => triangle[i % 3]);
            assert.ok(time(triangles) < 5e6);
        }
    });
});

it("shortens the edges of earcut's triangles", () => {
    const star = Array.from({length: 200}, (_, i) => [Math.cos(i / 100 * Math.PI), Math.sin(i / 100 * Math.PI)]
        .map((v) => v * (i % 2 ? 1 : 0.4))).flat();
    const triangles = earcut(star), length = (list) => list.reduce((sum, tail, e) => {
        const head = list[e % 3 < 2 ? e + 1 : e - 2];
        return sum + Math.abs(star[2 * tail] - star[2 * head]) + Math.abs(star[2 * tail + 1] - star[2 * head + 1]);
    }, 0);
    const before = length(triangles);
    assert.ok(flip(triangles, star) > 0);
    assert.ok(length(triangles) < 0.9 * before);
});

it("leaves the order of triangles if asked", () => {
    const triangles = [0, 1, 2, 0, 2, 3], vertices = [0, 0, 4, -1, 9, 0, 4, 1];
    flip(triangles, vertices, {order: "native"});
    assert.deepEqual(triangles, [0, 1, 3, 1, 2, 3]);
    flip.reorder(triangles, 4);
    assert.deepEqual(triangles, [0, 1, 3, 3, 1, 2]);
});

it("is the same for require and a script tag", () => {
    const required = createRequire(import.meta.url)("flip-triangles");
    const triangles = [0, 1, 2, 0, 2, 3];
    assert.equal(required(triangles, [0, 0, 4, -1, 9, 0, 4, 1]), 1);
    const page = {};
    new Function("globalThis", "exports", "module", "define", readFileSync(new URL("../flip-triangles.cjs", import.meta.url), "utf8"))
        .call(page, page);
    assert.equal(page.flipTriangles.toString(), required.toString());
});
