"use strict";
/* The grid to which a device snaps vertices: 1/256 px in the reference, but the APIs under WebGPU allow 1/16 px. For a device
   with a coarser grid, vertices are moved to that grid first, and the expected counters are computed again. */

const STEPS = [1, 2, 4, 8, 16];
const PROBE_PX = 64, PROBES = 80;

const snapPoints = (points, step) => (step === 1 ? points : points.map((value) => Math.floor((value + step / 2) / step) * step));

/* Exact counters of each polygon, as the CPU reference computes them. */
function countExactly(frame, rows) {
  const [fragments, quads, partial_quads, covering_triangles] = [0, 1, 2, 3].map(() => new Array(frame.polygons).fill(0));
  const corner = (index) => [frame.points[2 * index], frame.points[2 * index + 1]];
  for (let t = 0; t < rows.length; t += 3) {
    const polygon = frame.owner[rows[t]], counted = countTriangle(corner(rows[t]), corner(rows[t + 1]), corner(rows[t + 2]));
    [fragments, quads, partial_quads].forEach((values, k) => (values[polygon] += counted[k]));
    covering_triangles[polygon] += Number(counted[0] > 0);
  }
  return { fragments, quads, partial_quads, covering_triangles };
}

const COUNTERS = ["fragments", "quads", "partial_quads", "covering_triangles"];

/* Number of polygons with different counts. */
const countDifferences = (p, q) => p.fragments.filter((_, k) => COUNTERS.some((name) => p[name][k] !== q[name][k])).length;

/* Step of the device's grid in 1/256 px: the finest at which the device's counters equal the exact ones, or null. */
async function findStep(painter) {
  let seed = 7;
  const random = (below) => { seed = (seed * 16807) % 2147483647; return seed % below; };
  const points = new Int32Array(6 * PROBES).map(() => UNIT + random((PROBE_PX - 2) * UNIT));
  const rows = new Uint32Array(3 * PROBES).map((_, k) => k);
  const owner = rows.map((k) => Math.floor(k / 3));
  for (const step of STEPS) {
    const frame = { size: PROBE_PX, points: snapPoints(points, step), owner, polygons: PROBES };
    if (!countDifferences(await painter.count(frame, rows), countExactly(frame, rows))) return step;
  }
  return null;
}
