// CommonJS: require returns the function, which has the types as its members.

import flip = require("flip-triangles");
import type {Options, Triangles} from "flip-triangles";

const options: Options = {by: "quads", scale: 0.125};
const triangles: Triangles = new Uint16Array([0, 1, 2]);
const count: number = flip(triangles, [0, 0, 1, 0, 0, 1], options);
flip.reorder(triangles, count + 3);
// @ts-expect-error: unknown option
flip([0, 1, 2], [0, 0, 1, 0, 0, 1], {dimension: count});
