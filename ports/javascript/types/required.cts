// CommonJS: require returns the function.

import flip = require("flip-triangles");

const count: number = flip(new Uint16Array([0, 1, 2]), [0, 0, 1, 0, 0, 1], {by: "l1"});
// @ts-expect-error: unknown option
flip([0, 1, 2], [0, 0, 1, 0, 0, 1], {dimension: count});
