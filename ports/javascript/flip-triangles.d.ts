export interface Options {
    /** Coordinates per vertex in `vertices`, of which the first two are used; default 2. */
    dimensions?: number;
    /**
     * The test of a flip: "l1" (default) and "euclidean" require a shorter diagonal, by |dx| + |dy|
     * or Euclidean length; "delaunay" requires a vertex inside the circumcircle of the other triangle.
     */
    by?: "l1" | "euclidean" | "delaunay";
}

/** Three indices per triangle, in the same orientation, as from earcut. */
export type Triangles = number[] | Int8Array | Uint8Array | Uint8ClampedArray | Int16Array | Uint16Array
    | Int32Array | Uint32Array | Float32Array | Float64Array;

/** Flip diagonals in place until no flip is an improvement; return the number of flips. */
export default function flip(triangles: Triangles, vertices: ArrayLike<number>, options?: Options): number;
