/**
 * Return a transform for glTF-Transform's document.transform that flips diagonals of flat faces, on
 * the same vertices; the default of `by` is "euclidean".
 */
export default function retriangulate(options?: {by?: "l1" | "euclidean" | "delaunay"}): (document: any) => void;
