"use strict";
/* A polygon in pixels, its triangulations, and what each of them shades. It needs earcut, flipTriangles and grid.js. */

const MARGIN_PX = 1;
const MOST_FOR_OPTIMUM = 200;

/* Where each ring ends among the corners of all. */
function endsOf(rings) {
  let end = 0;
  return rings.map((ring) => (end += ring.length));
}

/* The polygon in a viewport of `size` px that holds its enclosing circle, turned by degrees, in 1/256 px: as
   harness/frame.py lays it with --fit circle. Returns { points, ends, rings } with flat points and where rings end. */
function place(rings, size, degrees) {
  const corners = rings[0];
  const middle = [0, 1].map((axis) => {
    const values = rings.flat().map((point) => point[axis]);
    return (Math.min(...values) + Math.max(...values)) / 2;
  });
  const angle = degrees * Math.PI / 180;
  let cos = Math.cos(angle), sin = Math.sin(angle);
  if (degrees % 90 === 0) [cos, sin] = [Math.round(cos), Math.round(sin)];
  const moved = rings.map((ring) => ring.map(([x, y]) => {
    const u = x - middle[0], v = y - middle[1];
    return [u * cos - v * sin, u * sin + v * cos];
  }));
  const extent = 2 * Math.max(...moved.flat().map(([x, y]) => Math.sqrt(x * x + y * y)));
  const scale = (size - 2 * MARGIN_PX) / extent;
  const snap = (value) => Math.round((value * scale + size / 2) * UNIT);
  const placed = moved.map((ring) => withoutRepeats(ring.map(([x, y]) => [snap(x), snap(y)])));
  const kept = placed.filter((ring, i) => ring.length > 2 || i === 0);
  return { points: kept.flat(2), ends: endsOf(kept), lost: corners.length - kept[0].length };
}

/* Whether no two edges cross or touch but neighbours at their corner. Edges are in the order of their left ends, so those
   behind the first that begins right of an edge's right end need no look. */
function isSimple({ points, ends }) {
  const starts = [0, ...ends], x = (p) => points[2 * p], y = (p) => points[2 * p + 1];
  const edges = ends.flatMap((end, ring) => Array.from({ length: end - starts[ring] }, (_, i) => [starts[ring] + i, starts[ring] + i + 1 < end ? starts[ring] + i + 1 : starts[ring]]))
    .sort(([a, b], [c, d]) => Math.min(x(a), x(b)) - Math.min(x(c), x(d)));
  const turn = (a, b, c) => Math.sign((x(b) - x(a)) * (y(c) - y(a)) - (y(b) - y(a)) * (x(c) - x(a)));
  const within = (a, b, c) => [x, y].every((of) => Math.min(of(a), of(b)) <= of(c) && of(c) <= Math.max(of(a), of(b)));
  const meet = ([a, b], [c, d]) => {
    const shared = [c, d].filter((p) => p === a || p === b);
    if (shared.length) {
      const [p] = shared, q = p === a ? b : a, r = p === c ? d : c;
      return turn(p, q, r) === 0 && (within(p, q, r) || within(p, r, q));
    }
    const [s, t, u, v] = [turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)];
    return (s * t < 0 && u * v < 0) || (!s && within(a, b, c)) || (!t && within(a, b, d)) || (!u && within(c, d, a)) || (!v && within(c, d, b));
  };
  return edges.every((edge, i) => {
    const [a, b] = edge, right = Math.max(x(a), x(b)), low = Math.min(y(a), y(b)), high = Math.max(y(a), y(b));
    for (let j = i + 1; j < edges.length; j++) {
      const [c, d] = edges[j];
      if (Math.min(x(c), x(d)) > right) break;
      if (Math.max(y(c), y(d)) >= low && Math.min(y(c), y(d)) <= high && meet(edge, edges[j])) return false;
    }
    return true;
  });
}

/* The triangulation of a ring without holes that has the least sum of half-perimeters of its triangles' bounding boxes.

   The best one of the corners i..j is a triangle i, k, j and the best ones on both sides of it: G. T. Klincsek, "Minimal
   triangulations of polygonal domains", Annals of Discrete Mathematics 9, 1980. It is enough to ask that each triangle
   turns left. The ring winds once round each point inside it and not at all round others, and so do all triangles
   together; each winds once round its own points. So they cover the inside once, and no diagonal has to be looked at. */
function optimum({ points, ends }) {
  const n = points.length / 2;
  if (ends.length > 1 || n > MOST_FOR_OPTIMUM) return null;
  const x = Float64Array.from({ length: n }, (_, i) => points[2 * i]), y = Float64Array.from({ length: n }, (_, i) => points[2 * i + 1]);
  const least = new Float64Array(n * n).fill(Infinity), split = new Int32Array(n * n).fill(-1);
  for (let i = 0; i + 1 < n; i++) least[i * n + i + 1] = 0;
  for (let apart = 2; apart < n; apart++) {
    for (let i = 0, j = apart; j < n; i++, j++) {
      const ax = x[i], ay = y[i], bx = x[j], by = y[j], u = bx - ax, v = by - ay;
      const left = Math.min(ax, bx), right = Math.max(ax, bx), low = Math.min(ay, by), high = Math.max(ay, by);
      let best = Infinity, at = -1;
      for (let k = i + 1; k < j; k++) {
        const both = least[i * n + k] + least[k * n + j];
        // The triangle i, k, j turns left.
        if (both >= best || (x[k] - ax) * v - (y[k] - ay) * u <= 0) continue;
        const cost = both + Math.max(right, x[k]) - Math.min(left, x[k]) + Math.max(high, y[k]) - Math.min(low, y[k]);
        if (cost < best) [best, at] = [cost, k];
      }
      least[i * n + j] = best;
      split[i * n + j] = at;
    }
  }
  if (least[n - 1] === Infinity) return null;
  const triangles = [], open = [[0, n - 1]];
  while (open.length) {
    const [i, j] = open.pop();
    if (j - i < 2) continue;
    const k = split[i * n + j];
    triangles.push(i, k, j);
    open.push([i, k], [k, j]);
  }
  return triangles;
}

/* Sum of the half-perimeters of the triangles' bounding boxes, in the unit of the points. */
function halfPerimeter(points, triangles) {
  let total = 0;
  for (let t = 0; t < triangles.length; t += 3) {
    for (const axis of [0, 1]) {
      const values = [0, 1, 2].map((k) => points[2 * triangles[t + k] + axis]);
      total += Math.max(...values) - Math.min(...values);
    }
  }
  return total;
}

/* Triangles of a simple polygon by the name of each way; null where it has none. */
function triangulations(placed) {
  const { points, ends } = placed;
  const ears = earcut.default(points, ends.slice(0, -1));
  const refined = [...ears], flipped = [...ears];
  earcut.refine(refined, points);
  flipTriangles(flipped, points);
  return { ears, refined, flipped, optimal: optimum(placed) };
}

/* What triangles shade. shaded, if given, are counts for each pixel of a viewport of `size` px, row 0 at the bottom:
   covered, and helpers, the helper lanes there. */
function shade(points, triangles, size = 0, shaded = null) {
  const totals = [0, 0, 0], corner = (index) => [points[2 * index], points[2 * index + 1]];
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [0, 1, 2].map((k) => corner(triangles[t + k]));
    countTriangle(...corners).forEach((value, k) => { totals[k] += value; });
    if (shaded) walkTriangle(...corners, (row, below, above) => mark(row, below, above, size, shaded));
  }
  const [fragments, quads, partial_quads] = totals;
  return { triangles: triangles.length / 3, fragments, quads, helper_lanes: 4 * quads - fragments, partial_quads };
}

function mark(row, below, above, size, { covered, helpers }) {
  const spans = [below, above].filter(([low, high]) => low <= high);
  if (!spans.length) return;
  const first = Math.min(...spans.map(([low]) => low)) >> 1, last = Math.max(...spans.map(([, high]) => high)) >> 1;
  for (let quad = first; quad <= last; quad++) {
    const isIn = (column, [low, high]) => low <= column && column <= high;
    const lanes = [below, above].map((span) => [isIn(2 * quad, span), isIn(2 * quad + 1, span)]);
    if (!lanes.flat().some(Boolean)) continue; // between two spans that do not meet
    lanes.forEach((pair, up) => pair.forEach((inside, right) => {
      const at = (row + up) * size + 2 * quad + right;
      if (2 * quad + right < size && row + up < size) (inside ? covered : helpers)[at]++;
    }));
  }
}
