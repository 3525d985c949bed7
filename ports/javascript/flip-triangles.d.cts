import type flipTriangles from "./flip-triangles.js";

declare const flip: typeof flipTriangles;
export = flip;
