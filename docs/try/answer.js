"use strict";
/* The comparison of a polygon's triangulations, and the sentences that report the result. Uses no elements of the page. */

const MIN_DIFFERENCE = 0.01; // share of ear clipping's lanes; a smaller difference is reported as none
const METHODS = [
  // key, title, description
  ["ears", "Ear clipping", "earcut, the usual choice: the baseline"],
  ["refined", "earcut’s refine", "Delaunay flips: fewer small angles"],
  ["flipped", "Flips", "to diagonals of smaller |dx| + |dy|"],
  ["optimal", "The optimum for H", "minimum width + height of all boxes"],
  ["quads", "The optimum for Q", "minimum expected quads: few triangles cover a pixel"],
];
const NAMES = { refined: "earcut’s refine", flipped: "flips", optimal: "the optimum for H", quads: "the optimum for Q" };

const formatPercent = (value) => `${(100 * value).toFixed(1)} %`;

/* Compare the triangulations of a polygon at a size and a rotation.

   placed : the polygon in the viewport
   fault : why the polygon is invalid, or null; isFaultOfSize: whether only the snapping to 1/256 px makes it invalid
   methods : { triangles, shaded, counts, saving, isBest } of each method that applies
   isDifferent : whether the lanes of two methods differ by MIN_DIFFERENCE or more */
function comparePolygon({ rings, size, rotation }) {
  const placed = fitToViewport(rings, size, rotation), ownFault = findFault(rings), fault = ownFault ?? findFault(placed.rings);
  const result = { placed, fault, isFaultOfSize: !ownFault && Boolean(fault), methods: {}, isDifferent: false };
  if (fault) return result;
  const lists = triangulateByMethods(placed);
  if (!lists.ears) return { ...result, fault: "is not covered exactly by earcut’s triangles", isFaultOfSize: true };
  for (const [name] of METHODS) {
    if (!lists[name]) continue;
    const shaded = { covered: new Uint8Array(size * size), helpers: new Uint8Array(size * size) };
    result.methods[name] = { triangles: lists[name], shaded, counts: countLanes(placed.points, lists[name], size, shaded) };
  }
  const quads = Object.values(result.methods).map(({ counts }) => counts.quads);
  const baseline = result.methods.ears.counts.quads, minimum = Math.min(...quads);
  for (const method of Object.values(result.methods)) {
    method.saving = baseline ? 1 - method.counts.quads / baseline : 0;
    method.isBest = method.counts.quads === minimum;
  }
  result.isDifferent = baseline > 0 && Math.max(...quads) - minimum >= MIN_DIFFERENCE * baseline;
  return result;
}

const joinNames = (names) => (names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names[0]);

/* The sentences that report a result of comparePolygon, as parts [text, CSS class]. */
function describeResult({ fault, isFaultOfSize, methods, placed, isDifferent }, size) {
  if (fault && !isFaultOfSize) return [[`Invalid: this polygon ${fault}. Drag a vertex until the polygon is valid, and its triangulations are compared. raster-harness repairs such a polygon.`]];
  if (fault) return [[`At ${size} px this polygon ${fault}, after its vertices are rounded to 1/256 px. Choose a larger size to compare its triangulations.`]];
  if (placed.points.length === 6) return [["A triangle has one triangulation. Add a vertex to have a choice."]];
  const others = Object.keys(NAMES).filter((name) => methods[name]).sort((p, q) => methods[q].saving - methods[p].saving);
  if (!isDifferent) return [[`No difference for this polygon at ${size} px: all triangulations take the same number of lanes, to within 1 %.`]];
  const difference = ({ saving }) => (formatPercent(Math.abs(saving)) === formatPercent(0) ? ["as many", ""] : saving >= 0 ? [`${formatPercent(saving)} fewer`, "less"] : [`${formatPercent(-saving)} more`, "more"]);
  const list = (names) => names.flatMap((name, i) => [[`${i ? "; " : ""}${NAMES[name]} `], difference(methods[name])]);
  const best = methods[others[0]];
  if (!best || best.saving < MIN_DIFFERENCE) {
    return [[`At ${size} px no method saves 1 % of ear clipping’s lanes, but some take more: `], ...list(others.filter((name) => -methods[name].saving >= MIN_DIFFERENCE)), ["."]];
  }
  const first = others.filter((name) => methods[name].isBest), rest = others.filter((name) => !methods[name].isBest);
  const pieces = [[`Best at ${size} px: ${joinNames(first.map((name) => NAMES[name]))}, with `], difference(best), [" lanes than ear clipping. "]];
  if (rest.length) pieces.push(["Then: "], ...list(rest), ["."]);
  return pieces;
}

/* The reason why a method has no triangulation of the polygon, as a phrase. */
function explainMissing({ fault, isFaultOfSize, placed }) {
  if (fault) return isFaultOfSize ? "invalid at this size" : "the polygon is invalid";
  if (placed.ends.length > 1) return "this page computes it without holes only; raster-harness also with holes";
  return placed.points.length / 2 > MAX_OPTIMUM_VERTICES ? `this page computes it up to ${MAX_OPTIMUM_VERTICES} vertices` : "its triangles do not cover the polygon exactly";
}

/* Width and height of points in px. */
function measureSize(rings) {
  const [left, bottom, right, top] = computeBounds(rings.flat());
  return [right - left, top - bottom].map((length) => Math.round(length / UNIT));
}
