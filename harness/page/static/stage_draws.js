"use strict";
/* The draws that separate the stages of a GPU, as harness/profile/stage_draws.py makes them. */

const MESH_ACROSS = 60, MESH_ALONG = 28, PATCH = 4, STRIDE = 1033;
const SMALL_SIDE = 128, ON_SAMPLE = 80, OFF_SAMPLE = 144, SAMPLE_JITTER = 32;

const triplesOf = (rows, order) => order.flatMap((k) => rows.slice(3 * k, 3 * k + 3));

/* Indices of a mesh's triangles, ordered by patches of PATCH x PATCH squares. */
const patchOrder = () => range(MESH_ALONG / PATCH).flatMap((high) => range(MESH_ACROSS / PATCH).flatMap((wide) =>
  range(PATCH).flatMap((row) => range(2 * PATCH).map((k) => 2 * ((high * PATCH + row) * MESH_ACROSS + wide * PATCH) + k))));

/* Indices of a mesh's triangles in runs whose lengths repeat a pattern; consecutive runs are far apart in the mesh. */
function runOrder(pattern) {
  const starts = [0], size = 2 * MESH_ACROSS * MESH_ALONG;
  while (starts.at(-1) < size) starts.push(starts.at(-1) + pattern[(starts.length - 1) % pattern.length]);
  const runs = starts.length - 1;
  return range(runs).flatMap((k) => {
    const run = (k * STRIDE) % runs;
    return range(starts[run + 1] - starts[run]).map((step) => starts[run] + step);
  });
}

/* Lower corners of cells, row by row: [x, y] in 1/256 px; pitch and start in px. */
const gridCells = (size, columns, [wide, high], [left, low]) =>
  range(size).map((k) => [((k % columns) * wide + left) * UNIT, (over(k, columns) * high + low) * UNIT]);

const computeJitter = (number) => [number % SAMPLE_JITTER, over(number, UNIT) % SAMPLE_JITTER];

/* An isolated triangle in each cell; `quarters` of every four triangles cover one sample, the others none. */
const smallTriangles = (cells, numbers, quarters) => inOrder(cells.flatMap((cell, k) => {
  const offset = k % 4 < quarters ? ON_SAMPLE : OFF_SAMPLE, jitter = computeJitter(numbers[k]);
  const [x, y] = cell.map((start, axis) => start + offset + jitter[axis]);
  return [x, y, x + SMALL_SIDE, y, x, y + SMALL_SIDE];
}));

/* A patch of 32 triangles in each cell; in `quarters` of every four patches, every triangle covers one sample. */
function patches(cells, numbers, quarters) {
  const line = PATCH + 1, small = SMALL_SIDE / PATCH;
  const points = cells.flatMap((cell, k) => {
    const [[wide, high], offset] = k % 4 < quarters ? [[UNIT, 2 * UNIT], 0] : [[small, small], OFF_SAMPLE];
    const jitter = computeJitter(numbers[k]), [x, y] = cell.map((start, axis) => start + offset + jitter[axis]);
    return range(line * line).flatMap((vertex) => [x + (vertex % line) * wide, y + over(vertex, line) * high]);
  });
  const once = meshRows(PATCH, PATCH);
  return { points, rows: cells.flatMap((_, k) => once.map((vertex) => vertex + k * line * line)) };
}

const largeTriangles = (side, cells, numbers) => inOrder(cells.flatMap(([left, low], k) =>
  triangleOf(side * UNIT, side * UNIT)(numbers[k]).flatMap(([x, y]) => [x + left, y + low])));

/* Two draws in one index buffer: one after the other, or evenly interleaved in blocks of `block` and `otherBlock` triangles. */
function joined([one, block], [other, otherBlock], interleaved) {
  const shift = one.points.length / 2, triangles = [one, other].map(({ rows }) => rows.length / 3);
  const points = [...one.points, ...other.points], rows = [...one.rows, ...other.rows.map((vertex) => vertex + shift)];
  if (!interleaved) return { points, rows };
  const blocks = [Math.ceil(triangles[0] / block), Math.ceil(triangles[1] / otherBlock)];
  const keys = range(triangles[0] + triangles[1]).map((k) => (k < triangles[0]
    ? (2 * over(k, block) + 1) * blocks[1] : (2 * over(k - triangles[0], otherBlock) + 1) * blocks[0]));
  return { points, rows: triplesOf(rows, range(keys.length).sort((p, q) => keys[p] - keys[q])) };
}

function makeStageDraws(seed) {
  const draws = [];
  [128, 256, 512].forEach((side, k) => {
    const { points, rows } = jitteredMesh(MESH_ACROSS, MESH_ALONG, side, mixed(seed, 901 + k, (MESH_ACROSS + 1) * (MESH_ALONG + 1)));
    const orders = [patchOrder(), ...[[30], [4], [2], [1, 1, 2], [1]].map(runOrder)];
    draws.push(...orders.map((order) => ({ points, rows: triplesOf(rows, order) })));
  });
  const isolated = gridCells(3000, 60, [4, 4], [8, 8]), compact = gridCells(96, 12, [8, 12], [8, 8]);
  const [first, second] = [mixed(seed, 911, 3000), mixed(seed, 912, 96)];
  draws.push(...range(5).map((quarters) => smallTriangles(isolated, first, quarters)));
  draws.push(...[0, 2, 4].map((quarters) => patches(compact, second, quarters)));
  [[4, 8], [12, 16]].forEach(([side, pitch], k) => {
    const size = 15 * (SIDE / pitch - 2), numbers = mixed(seed, 921 + k, size);
    draws.push(...[8, 16, 32, 64].map((line) => largeTriangles(side,
      gridCells(size, 15, [64, pitch], [line - side / 2, pitch + (pitch - side) / 2]), numbers)));
  });
  const numbers = [931, 932, 933].map((number) => mixed(seed, number, 2200));
  const populations = [[smallTriangles(gridCells(2200, 100, [4, 4], [8, 8]), numbers[0], 0), 10],
    [patches(gridCells(57, 48, [8, 12], [8, 128]), numbers[1], 4), 32],
    [largeTriangles(64, gridCells(28, 14, [68, 68], [8, 256]), numbers[2]), 1]];
  const [vertices, covering, quads] = populations;
  draws.push(...populations.map(([population]) => population));
  draws.push(joined(vertices, covering, true), joined(vertices, quads, true), joined(covering, quads, true));
  draws.push(joined(vertices, quads, false));
  return draws;
}
