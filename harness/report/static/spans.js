"use strict";
/* Which pixels a triangle covers, row by row in integers on the 1/256 px grid, as harness/rasterisers/spans.py has it:
   top-left rule (y up), complete 2x2 quads. All products stay below 2^53, so they are exact. */

const UNIT = 256, HALF = 128;

/* First and last pixel whose centre lies in the bounding box of corners, along x (0) or y (1). */
function pixelRange(corners, axis) {
  const values = corners.map((p) => p[axis]);
  return [Math.ceil((Math.min(...values) - HALF) / UNIT), Math.floor((Math.max(...values) - HALF) / UNIT)];
}

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

/* Number of quads that two spans of neighbouring rows touch: cells of two pixels touched by one or both. */
function countCells(p, q) {
  if (p[0] > q[0]) [p, q] = [q, p];
  let total = 0, reach = -1;
  for (const [first, last] of [p, q]) {
    if (first > last) continue;
    total += Math.max(0, (last >> 1) - Math.max(first >> 1, reach + 1) + 1);
    reach = Math.max(reach, last >> 1);
  }
  return total;
}

/* Number of quads whose four pixels are covered by two spans of neighbouring rows. */
const countFullQuads = (p, q) => Math.max(0, ((Math.min(p[1], q[1]) + 1) >> 1) - ((Math.max(p[0], q[0]) + 1) >> 1));

/* Call see(y, below, above) for each pair of rows y (even) and y + 1 of a triangle with corners [x, y] in 1/256 px; below and
   above are [first, last] covered pixel of rows y and y + 1 by the top-left rule, empty if first > last. */
function walkTriangle(a, b, c, see) {
  const doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  if (!doubled) return;
  const ring = doubled > 0 ? [a, b, c] : [a, c, b];
  const edges = ring.map((p, i) => {
    const q = ring[(i + 1) % 3], dx = q[0] - p[0], dy = q[1] - p[1];
    const closed = dy < 0 || (dy === 0 && dx > 0);
    return [dx * (HALF - p[1]) - dy * (HALF - p[0]) - (closed ? 0 : 1), UNIT * dx, UNIT * dy];
  });
  const [left, right] = pixelRange(ring, 0), [first, last] = pixelRange(ring, 1);
  if (left > right) return;
  const row = (y) => (y < first || y > last ? [0, -1] : spanOf(edges, y, left, right));
  for (let y = first - (first & 1); y <= last; y += 2) see(y, row(y), row(y + 1));
}

/* [fragments, quads, partial quads] of a triangle. */
function countTriangle(a, b, c) {
  let fragments = 0, quads = 0, whole = 0;
  walkTriangle(a, b, c, (_, below, above) => {
    for (const [low, high] of [below, above]) fragments += Math.max(0, high - low + 1);
    quads += countCells(below, above);
    whole += countFullQuads(below, above);
  });
  return [fragments, quads, quads - whole];
}
