// Types of the interface: valid calls, and invalid calls that must be errors.

import flip, {type Options, type Triangles} from "flip-triangles";
import retriangulate from "flip-triangles/gltf";
import flipShapes from "flip-triangles/three";

const vertices = new Float32Array([0, 0, 0, 2, -1, 0, 9, 0, 0, 2, 1, 0]);
const options: Options = {dimensions: 3, by: "euclidean"};
const count: number = flip([0, 1, 2, 0, 2, 3], vertices, options);
flip(new Uint16Array([0, 1, 2]), [0, 0, 1, 0, 0, 1] as const);
flip(new Uint32Array(3), vertices, {dimensions: 3, order: "native"});
flip.reorder(new Uint32Array(3), 4);

// The type of BufferAttribute.array in three.js.
type Attribute = Int8Array | Uint8Array | Uint8ClampedArray | Int16Array | Uint16Array | Int32Array | Uint32Array
    | Float32Array | Float64Array;
export function refine(index: {array: Attribute}, position: {array: Attribute}): number {
    const triangles: Triangles = index.array;
    return count + flip(triangles, position.array, {dimensions: 3, by: "l1"});
}

const transform: (document: object) => void = retriangulate({by: "l1"});
transform({});

flip([0, 1, 2], vertices, {by: "quads", scale: 4, order: "native"});
// @ts-expect-error: quads need a scale
flip([0, 1, 2], vertices, {by: "quads"});
// @ts-expect-error: a model has no scale
retriangulate({by: "quads"});
// @ts-expect-error: unknown test
flip([0, 1, 2], vertices, {by: "L1"});
const fixed: readonly number[] = [0, 1, 2];
// @ts-expect-error: triangles are changed in place
flip(fixed, vertices);
// @ts-expect-error: vertices are required
flip([0, 1, 2]);
// @ts-expect-error: the result is the number of flips, not the triangles
const triangles: number[] = flip([0, 1, 2], vertices);

// The required part of the class in three.js.
class ShapeUtils {
    static triangulateShape(contour: {x: number; y: number}[], holes: {x: number; y: number}[][]): number[][] {
        return holes.map(() => [contour.length]);
    }
}
const restore: () => void = flipShapes(ShapeUtils, {by: "l1"});
restore();
