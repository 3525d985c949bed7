export type Options = {
    /** Coordinates per vertex in `vertices`, of which the first two are used; default 2. */
    dimensions?: number;
    /** Order of the result: as by `reorder` (default), or a flip's two triangles at the positions of the old two. */
    order?: "walk" | "native";
} & ({
    /**
     * The test of a flip: "l1" (default) and "euclidean" require a shorter diagonal, by |dx| + |dy|
     * or Euclidean length; "delaunay" requires a vertex inside the circumcircle of the other triangle.
     */
    by?: "l1" | "euclidean" | "delaunay";
    scale?: number;
} | {
    /** Require fewer expected 2x2 pixel quads. */
    by: "quads";
    /** Pixels per unit: for a map tile, its pixels / extent; for a font, pixels per em / units per em. */
    scale: number;
});

/** Three indices per triangle, in the same orientation, as from earcut. */
export type Triangles = number[] | Int8Array | Uint8Array | Uint8ClampedArray | Int16Array | Uint16Array
    | Int32Array | Uint32Array | Float32Array | Float64Array;

declare const flip: {
    /** Flip diagonals in place until no flip is an improvement; return the number of flips. */
    (triangles: Triangles, vertices: ArrayLike<number>, options?: Options): number;
    /** Put triangles in place in a walk from neighbour to neighbour; all indices are below `numberOfVertices`. */
    reorder(triangles: Triangles, numberOfVertices: number): void;
};
export default flip;
