// Test of flipShapes: the same vertices and the same area.

import assert from "node:assert/strict";
import {it} from "node:test";
import {ExtrudeGeometry, Path, Shape, ShapeGeometry, ShapeUtils, Vector2} from "three";
import flipShapes from "flip-triangles/three";

const ring = (n, radius) => Array.from({length: n}, (_, i) => new Vector2(
    radius * (i % 2 ? 1 : 0.8) * Math.cos(i / n * 2 * Math.PI), radius * (i % 2 ? 1 : 0.8) * Math.sin(i / n * 2 * Math.PI)));

function outline() {
    const shape = new Shape([...ring(40, 9), ring(40, 9)[0]]); // its last point repeats its first
    shape.holes.push(new Path(ring(12, 3).reverse()));
    return shape;
}

const area = ({index, attributes: {position}}) => {
    let sum = 0;
    for (let t = 0; t < index.count; t += 3) {
        const [a, b, c] = [0, 1, 2].map((k) => new Vector2().fromBufferAttribute(position, index.getX(t + k)));
        sum += b.clone().sub(a).cross(c.clone().sub(a)) / 2;
    }
    return sum;
};

it("flips shapes and extrusions until the original is restored", () => {
    const plain = new ShapeGeometry(outline()), solid = new ExtrudeGeometry(outline(), {depth: 1, bevelEnabled: false});
    const restore = flipShapes(ShapeUtils, {by: "l1"});
    const flipped = new ShapeGeometry(outline()), flippedSolid = new ExtrudeGeometry(outline(), {depth: 1, bevelEnabled: false});
    restore();
    assert.deepEqual(flipped.attributes.position.array, plain.attributes.position.array);
    assert.notDeepEqual(flipped.index.array, plain.index.array);
    assert.ok(Math.abs(area(flipped) - area(plain)) < 1e-3);
    assert.equal(flippedSolid.attributes.position.count, solid.attributes.position.count);
    assert.notDeepEqual(flippedSolid.attributes.position.array, solid.attributes.position.array);
    assert.deepEqual(new ShapeGeometry(outline()).index.array, plain.index.array);
});
