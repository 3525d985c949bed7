"use strict";
/* A polygon in pixels, its triangulations, and the lanes that they shade. Uses earcut, flipTriangles, spans.js, validity.js. */

const MARGIN_PX = 1;
const MAX_OPTIMUM_VERTICES = 200;

/* For each ring the number of vertices of that ring and the rings before it. */
function listRingEnds(rings) {
  let end = 0;
  return rings.map((ring) => (end += ring.length));
}

/* The polygon in 1/256 px, rotated by degrees, in a viewport of `size` px that contains the circle about the centre of its
   bounding box, as by harness/frame.py with --fit circle. Returns { rings, points, ends, lost }: flat points, ring ends, and the number of vertices of the
   exterior that coincide with the next vertex. */
function fitToViewport(rings, size, degrees) {
  const [left, bottom, right, top] = computeBounds(rings.flat()), middle = [(left + right) / 2, (bottom + top) / 2];
  const angle = degrees * Math.PI / 180;
  let cos = Math.cos(angle), sin = Math.sin(angle);
  if (degrees % 90 === 0) [cos, sin] = [Math.round(cos), Math.round(sin)];
  const rotated = rings.map((ring) => ring.map(([x, y]) => {
    const u = x - middle[0], v = y - middle[1];
    return [u * cos - v * sin, u * sin + v * cos];
  }));
  const extent = 2 * rotated.flat().reduce((radius, [x, y]) => Math.max(radius, Math.sqrt(x * x + y * y)), 0);
  const scale = (size - 2 * MARGIN_PX) / extent;
  const snap = (value) => Math.round((value * scale + size / 2) * UNIT);
  const snapped = rotated.map((ring) => removeRepeats(ring.map(([x, y]) => [snap(x), snap(y)])));
  const placed = snapped.filter((ring, i) => ring.length > 2 || i === 0);
  return { rings: placed, points: placed.flat(2), ends: listRingEnds(placed), lost: rings[0].length - placed[0].length };
}

/* Half the perimeter of a triangle's bounding box. */
function computeHalfPerimeter(ax, ay, bx, by, cx, cy) {
  return Math.max(ax, bx, cx) - Math.min(ax, bx, cx) + Math.max(ay, by, cy) - Math.min(ay, by, cy);
}

/* The mean number of quads with a covered pixel centre over all positions of a triangle on the pixel grid, for coordinates in
   1/256 px: `expected_quads` of triangulators/criteria/features.py, which derives the formula. */
function expectedQuads(ax, ay, bx, by, cx, cy) {
  const cross = Math.abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) / UNIT ** 2;
  if (cross === 0) return 0;
  const sign = (bx - ax) * (cy - ay) > (by - ay) * (cx - ax) ? 1 : -1;
  const edges = [[bx - ax, by - ay], [cx - bx, cy - by], [ax - cx, ay - cy]].map(([x, y]) => [sign * x / UNIT, sign * y / UNIT]);
  const common = (lost) => Math.max(0, 1 - lost / cross) ** 2;
  const extent = (p, q, r) => (Math.max(p, q, r) - Math.min(p, q, r)) / UNIT;
  const width = extent(ax, bx, cx), height = extent(ay, by, cy);
  let squares = -common(extent(ax - ay, bx - by, cx - cy)) - common(extent(ax + ay, bx + by, cx + cy)) - common(width + height);
  for (const r of [-1, 1]) {
    for (const u of [-1, 1]) squares += common(-edges.reduce((sum, [x, y]) => sum + Math.min(0, r * y, u * x), 0));
  }
  return cross / 8 * (4 - 2 * (common(width) + common(height)) + squares);
}

/* The triangulation of a ring without holes with the minimum sum of a cost, a function of three vertices.

   The optimum of the vertices i..j is a triangle i, k, j and the optima on both sides of the triangle: G. T. Klincsek, "Minimal
   triangulations of polygonal domains", Annals of Discrete Mathematics 9, 1980. It is sufficient that every triangle turns
   left: the winding numbers of the triangles add up to the ring's winding number, which is 1 inside and 0 outside, and each
   triangle has winding number 1 inside. So the triangles cover the interior once, and diagonals need no visibility test. */
function optimalTriangles({ points, ends }, costOf) {
  const n = points.length / 2;
  if (ends.length > 1 || n > MAX_OPTIMUM_VERTICES) return null;
  const x = Float64Array.from({ length: n }, (_, i) => points[2 * i]), y = Float64Array.from({ length: n }, (_, i) => points[2 * i + 1]);
  const minimum = new Float64Array(n * n).fill(Infinity), split = new Int32Array(n * n).fill(-1);
  for (let i = 0; i + 1 < n; i++) minimum[i * n + i + 1] = 0;
  for (let span = 2; span < n; span++) {
    for (let i = 0, j = span; j < n; i++, j++) {
      const ax = x[i], ay = y[i], bx = x[j], by = y[j], u = bx - ax, v = by - ay;
      let best = Infinity, apex = -1;
      for (let k = i + 1; k < j; k++) {
        const sides = minimum[i * n + k] + minimum[k * n + j];
        // The triangle i, k, j turns left.
        if (sides >= best || (x[k] - ax) * v - (y[k] - ay) * u <= 0) continue;
        const cost = sides + costOf(ax, ay, bx, by, x[k], y[k]);
        if (cost < best) [best, apex] = [cost, k];
      }
      minimum[i * n + j] = best;
      split[i * n + j] = apex;
    }
  }
  if (minimum[n - 1] === Infinity) return null;
  const triangles = [], pending = [[0, n - 1]];
  while (pending.length) {
    const [i, j] = pending.pop();
    if (j - i < 2) continue;
    const k = split[i * n + j];
    triangles.push(i, k, j);
    pending.push([i, k], [k, j]);
  }
  return triangles;
}

/* Whether the areas of triangles add up to the area of the polygon, exactly: overlaps and gaps change the sum. */
function coversArea(triangles, points, rings) {
  const vertex = (index) => [points[2 * index], points[2 * index + 1]];
  let total = 0;
  for (let t = 0; t < triangles.length; t += 3) total += Math.abs(orientation(...[0, 1, 2].map((k) => vertex(triangles[t + k]))));
  return total === rings.reduce((sum, ring, i) => sum + Math.abs(doubledArea(ring)) * (i ? -1 : 1), 0);
}

/* Triangulate a valid polygon by each method: name -> triangles, or null if the method is limited to other polygons or its
   triangles do not cover the polygon exactly. */
function triangulateByMethods(placed) {
  const { rings, points, ends } = placed;
  const ears = earcut.default(points, ends.slice(0, -1));
  const refined = [...ears], flipped = [...ears];
  earcut.refine(refined, points);
  flipTriangles(flipped, points);
  const methods = { ears, refined, flipped, optimal: optimalTriangles(placed, computeHalfPerimeter), quads: optimalTriangles(placed, expectedQuads) };
  return Object.fromEntries(Object.entries(methods).map(([name, triangles]) => [name, triangles && coversArea(triangles, points, rings) ? triangles : null]));
}

/* The number of batches in which a GPU transforms the vertices of triangles: a batch has up to 32 distinct vertices and 32
   triangles, as in harness/rasterisers/vertex_batches.py. */
function countBatches(triangles, maxVertices = 32, maxTriangles = 32) {
  const batchOf = new Map();
  let batches = triangles.length ? 1 : 0, vertices = 0, size = 0;
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [0, 1, 2].map((k) => triangles[t + k]);
    let added = corners.filter((vertex) => batchOf.get(vertex) !== batches);
    if (size === maxTriangles || vertices + added.length > maxVertices) {
      batches++;
      vertices = size = 0;
      added = corners;
    }
    for (const vertex of added) batchOf.set(vertex, batches);
    vertices += added.length;
    size++;
  }
  return batches;
}

/* Count the lanes, quads and vertex batches of triangles. `shaded`, if given, receives counts for each pixel of a viewport of
   `size` px, row 0 at the bottom: `covered` by triangles, and `helpers` (helper lanes). */
function countLanes(points, triangles, size = 0, shaded = null) {
  const totals = [0, 0, 0], vertex = (index) => [points[2 * index], points[2 * index + 1]];
  let covering_triangles = 0;
  for (let t = 0; t < triangles.length; t += 3) {
    const vertices = [0, 1, 2].map((k) => vertex(triangles[t + k]));
    const counts = countTriangle(...vertices);
    counts.forEach((value, k) => { totals[k] += value; });
    covering_triangles += Number(counts[0] > 0);
    if (shaded) walkTriangle(...vertices, (row, below, above) => markLanes(row, below, above, size, shaded));
  }
  const [fragments, quads, partial_quads] = totals;
  return { triangles: triangles.length / 3, fragments, quads, helper_lanes: 4 * quads - fragments, partial_quads, covering_triangles, vertex_batches: countBatches(triangles) };
}

/* Add a triangle's covered lanes and helper lanes in a pair of rows (row, row + 1) to the counts of pixels. */
function markLanes(row, below, above, size, { covered, helpers }) {
  const spans = [below, above].filter(([low, high]) => low <= high);
  if (!spans.length) return;
  const first = Math.min(...spans.map(([low]) => low)) >> 1, last = Math.max(...spans.map(([, high]) => high)) >> 1;
  for (let quad = first; quad <= last; quad++) {
    const isIn = (column, [low, high]) => low <= column && column <= high;
    const lanes = [below, above].map((span) => [isIn(2 * quad, span), isIn(2 * quad + 1, span)]);
    if (!lanes.flat().some(Boolean)) continue; // a gap between the spans of the two rows
    lanes.forEach((pair, up) => pair.forEach((isCovered, right) => {
      const index = (row + up) * size + 2 * quad + right;
      if (2 * quad + right < size && row + up < size) (isCovered ? covered : helpers)[index]++;
    }));
  }
}
