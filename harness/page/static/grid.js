"use strict";
/* The grid that a device snaps vertices to. Ours is 1/256 px; the standards below WebGPU allow one of 1/16 px. On such
   a device the polygons are moved to its grid first, and what is expected is counted anew: row by row in integers, as
   harness/rasterisers/spans.py does it. All products stay below 2^53, so they are exact. */

const UNIT = 256, HALF = 128;
const STEPS = [1, 2, 4, 8, 16];
const PROBE_PX = 64, PROBES = 80;

const snapped = (points, step) => (step === 1 ? points : points.map((value) => Math.floor((value + step / 2) / step) * step));

const firstPixel = (low) => Math.ceil((low - HALF) / UNIT);
const lastPixel = (high) => Math.floor((high - HALF) / UNIT);

/* First and last covered pixel of a row; empty if first > last. */
function spanOf(edges, y, left, right) {
  for (const [constant, perRow, perColumn] of edges) {
    const value = constant + perRow * y;
    if (perColumn > 0) right = Math.min(right, Math.floor(value / perColumn));
    else if (perColumn < 0) left = Math.max(left, Math.ceil(value / perColumn));
    else if (value < 0) return [left, left - 1];
  }
  return [left, right];
}

/* How many cells of two pixels two spans touch together. */
function cellsOf(p, q) {
  if (p[0] > q[0]) [p, q] = [q, p];
  let total = 0, reach = -1;
  for (const [first, last] of [p, q]) {
    if (first > last) continue;
    total += Math.max(0, (last >> 1) - Math.max(first >> 1, reach + 1) + 1);
    reach = Math.max(reach, last >> 1);
  }
  return total;
}

/* How many quads have both pixels of both spans. */
const wholeQuads = (p, q) => Math.max(0, ((Math.min(p[1], q[1]) + 1) >> 1) - ((Math.max(p[0], q[0]) + 1) >> 1));

/* Calls see(y, below, above) for each two rows y and y + 1, y even, of a triangle with corners [x, y] in 1/256 px: each
   row's first and last covered pixel by the top-left rule, empty if first > last. */
function walkTriangle(a, b, c, see) {
  const doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  if (!doubled) return;
  const ring = doubled > 0 ? [a, b, c] : [a, c, b];
  const edges = ring.map((p, i) => {
    const q = ring[(i + 1) % 3], dx = q[0] - p[0], dy = q[1] - p[1];
    const closed = dy < 0 || (dy === 0 && dx > 0);
    return [dx * (HALF - p[1]) - dy * (HALF - p[0]) - (closed ? 0 : 1), UNIT * dx, UNIT * dy];
  });
  const reach = (axis) => {
    const values = ring.map((p) => p[axis]);
    return [firstPixel(Math.min(...values)), lastPixel(Math.max(...values))];
  };
  const [left, right] = reach(0), [first, last] = reach(1);
  if (left > right) return;
  const row = (y) => (y < first || y > last ? [0, -1] : spanOf(edges, y, left, right));
  for (let y = first - (first & 1); y <= last; y += 2) see(y, row(y), row(y + 1));
}

/* [fragments, quads, partial quads] of a triangle. */
function countTriangle(a, b, c) {
  let fragments = 0, quads = 0, whole = 0;
  walkTriangle(a, b, c, (_, below, above) => {
    for (const [low, high] of [below, above]) fragments += Math.max(0, high - low + 1);
    quads += cellsOf(below, above);
    whole += wholeQuads(below, above);
  });
  return [fragments, quads, quads - whole];
}

/* What the reference counts of each polygon. */
function countExactly(frame, rows) {
  const [fragments, quads, partial_quads] = [0, 1, 2].map(() => new Array(frame.polygons).fill(0));
  const corner = (index) => [frame.points[2 * index], frame.points[2 * index + 1]];
  for (let t = 0; t < rows.length; t += 3) {
    const counted = countTriangle(corner(rows[t]), corner(rows[t + 1]), corner(rows[t + 2]));
    [fragments, quads, partial_quads].forEach((values, k) => (values[frame.owner[rows[t]]] += counted[k]));
  }
  return { fragments, quads, partial_quads };
}

/* Polygons in which two counts differ. */
const differingOf = (p, q) => p.fragments.filter((_, k) => ["fragments", "quads", "partial_quads"].some((name) => p[name][k] !== q[name][k])).length;

/* The coarsest grid's step that is the device's, in 1/256 px; null if it counts by another rule on all of them. */
async function findStep(painter) {
  let seed = 7;
  const random = (below) => { seed = (seed * 16807) % 2147483647; return seed % below; };
  const points = new Int32Array(6 * PROBES).map(() => UNIT + random((PROBE_PX - 2) * UNIT));
  const rows = new Uint32Array(3 * PROBES).map((_, k) => k);
  const owner = rows.map((k) => Math.floor(k / 3));
  for (const step of STEPS) {
    const frame = { size: PROBE_PX, points: snapped(points, step), owner, polygons: PROBES };
    if (!differingOf(await painter.count(frame, rows), countExactly(frame, rows))) return step;
  }
  return null;
}
