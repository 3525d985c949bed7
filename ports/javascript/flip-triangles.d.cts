import type flipTriangles from "./flip-triangles.js" with {"resolution-mode": "import"};
import type * as types from "./flip-triangles.js" with {"resolution-mode": "import"};

declare const flip: typeof flipTriangles;
declare namespace flip {
    export type Options = types.Options;
    export type Triangles = types.Triangles;
}
export = flip;
