import type {Options} from "./flip-triangles.js";

/** What is needed of three.js's ShapeUtils. */
export interface Triangulates {
    triangulateShape(contour: any, holes: any): number[][];
}

/**
 * Let ShapeUtils.triangulateShape, which ShapeGeometry and ExtrudeGeometry call, flip what it returns;
 * by "euclidean" where it is left out. Returns what puts the original back.
 */
export default function flipShapes(ShapeUtils: Triangulates, options?: Pick<Options, "by">): () => void;
