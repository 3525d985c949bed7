// What a TypeScript program may write and, where an error is expected, what it may not.

import flip, {type Options, type Triangles} from "flip-triangles";
import retriangulate from "flip-triangles/gltf";
import flipShapes from "flip-triangles/three";

const vertices = new Float32Array([0, 0, 0, 2, -1, 0, 9, 0, 0, 2, 1, 0]);
const options: Options = {dimensions: 3, by: "euclidean"};
const count: number = flip([0, 1, 2, 0, 2, 3], vertices, options);
flip(new Uint16Array([0, 1, 2]), [0, 0, 1, 0, 0, 1] as const);
flip(new Uint32Array(3), vertices, {dimensions: 3});

// The type that three.js gives a BufferAttribute's array.
type Attribute = Int8Array | Uint8Array | Uint8ClampedArray | Int16Array | Uint16Array | Int32Array | Uint32Array
    | Float32Array | Float64Array;
export function refine(index: {array: Attribute}, position: {array: Attribute}): number {
    const triangles: Triangles = index.array;
    return count + flip(triangles, position.array, {dimensions: 3, by: "l1"});
}

const transform: (document: object) => void = retriangulate({by: "l1"});
transform({});

// @ts-expect-error: there is no such length
flip([0, 1, 2], vertices, {by: "L1"});
const fixed: readonly number[] = [0, 1, 2];
// @ts-expect-error: triangles are changed in place
flip(fixed, vertices);
// @ts-expect-error: vertices are needed
flip([0, 1, 2]);
// @ts-expect-error: it is the number of flips, not the triangles
const triangles: number[] = flip([0, 1, 2], vertices);

// three.js's class, as far as it is used.
class ShapeUtils {
    static triangulateShape(contour: {x: number; y: number}[], holes: {x: number; y: number}[][]): number[][] {
        return holes.map(() => [contour.length]);
    }
}
const takeBack: () => void = flipShapes(ShapeUtils, {by: "l1"});
takeBack();
