/** The required part of three.js's ShapeUtils. */
export interface Triangulates {
    triangulateShape(contour: any, holes: any): number[][];
}

/**
 * Replace ShapeUtils.triangulateShape, which ShapeGeometry and ExtrudeGeometry call, by a version that
 * flips diagonals; the default of `by` is "euclidean". Returns a function that restores the original.
 */
export default function flipShapes(ShapeUtils: Triangulates, options?: {by?: "l1" | "euclidean" | "delaunay"}): () => void;
