export interface Options {
    /** Numbers a vertex in `vertices`, of which the first two are used; 2 where it is left out. */
    dimensions?: number;
    /**
     * What a flip must lessen: the diagonal's length, |dx| + |dy| ("l1", where it is left out) or
     * Euclidean, or, with "delaunay", whether a corner lies in the other triangle's circle.
     */
    by?: "l1" | "euclidean" | "delaunay";
}

/** Three indices a triangle, all wound alike, as earcut returns them. */
export type Triangles = number[] | Int8Array | Uint8Array | Uint8ClampedArray | Int16Array | Uint16Array
    | Int32Array | Uint32Array | Float32Array | Float64Array;

/** Flip diagonals in place while a flip gains; return how many flips were made. */
export default function flip(triangles: Triangles, vertices: ArrayLike<number>, options?: Options): number;
