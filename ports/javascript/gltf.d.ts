import type {Options} from "./flip-triangles.js";

/**
 * A transform for glTF-Transform's document.transform: flat faces get shorter diagonals, on the same
 * vertices; by "euclidean" where it is left out.
 */
export default function retriangulate(options?: Pick<Options, "by">): (document: any) => void;
