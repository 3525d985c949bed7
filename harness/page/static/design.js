"use strict";
/* The draws of a profile in integers, as harness/profile/design.py and placing.py make them, with the same
   checksums. Only sums, products below 2^53, floor divisions and shifts are used. Points are flat: x, y, x, y, ... */

const SIDE = 1024, GAP = 512, MARGIN = 256;
const LEVEL = [1, 0, 1], STEEP = [0, 1, 1], SLANTED = [12, 5, 13], DIAGONAL = [21, 20, 29];
const MAX_TRIANGLES = 3000;

const over = (value, by) => Math.floor(value / by);

/* A pseudo-random 32-bit number for each of `size` positions, from the seed, the draw and the position. */
function mixed(seed, draw, size) {
  const start = ((seed % 2 ** 32) * 31 + draw * 65599) % 2 ** 32;
  return range(size).map((place) => {
    let value = Math.imul((place + 1 + start) >>> 0, 2654435761);
    for (let turn = 0; turn < 2; turn++) {
      value ^= value << 13;
      value ^= value >>> 17;
      value ^= value << 5;
    }
    return value >>> 0;
  });
}

function turned([x, y], [dx, dy, length]) {
  const half = length >> 1;
  return [over(x * dx - y * dy + half, length), over(x * dy + y * dx + half, length)];
}

/* Lower left corners of at most `wanted` cells, spread evenly over all cells that fit into the viewport after rotation. */
function cells(width, height, [dx, dy, length], wanted) {
  const wide = width + GAP, high = height + GAP, half = SIDE * 128 - MARGIN, most = half - UNIT;
  const reach = (size) => over(3 * half, 2 * size) + 2;
  // Coordinates are compared before the division in `turned`, which would round them.
  const least = -half * length - (length >> 1), beyond = most * length - (length >> 1);
  const within = (x, y) => {
    const across = x * dx - y * dy, up = x * dy + y * dx;
    return across >= least && across < beyond && up >= least && up < beyond;
  };
  const inside = [];
  for (let row = -reach(high); row <= reach(high); row++) {
    for (let column = -reach(wide); column <= reach(wide); column++) {
      const x = column * wide, y = row * high;
      if (within(x, y) && within(x + width, y + height) && within(x + width, y) && within(x, y + height)) inside.push([x, y]);
    }
  }
  const some = Math.min(wanted, inside.length);
  return range(some).map((k) => inside[over(k * inside.length, some)]);
}

/* Points of one copy of a shape in each cell; shape(number) returns the points of a copy relative to the cell. */
function placed(shape, [width, height], direction, numbers) {
  const middle = SIDE * 128;
  return cells(width, height, direction, numbers.length).flatMap(([left, low], k) => {
    const stray = [numbers[k] % UNIT, over(numbers[k], UNIT) % UNIT];
    return shape(numbers[k]).flatMap(([x, y]) => turned([left + x, low + y], direction).map((at, axis) => at + middle + stray[axis]));
  });
}

/* A function number -> triangle with a horizontal base; the number decides the apex's x and whether the apex points down. */
const triangleOf = (base, height) => (number) => {
  const apex = over(((number >>> 16) & 255) * base, 255);
  const corners = [[0, 0], [base, 0], [apex, height]];
  return (number >>> 24) & 1 ? corners.map(([x, y]) => [base - x, height - y]) : corners;
};

/* Integer points on an ellipse that touches a box, counter-clockwise from the right. */
function ringOf(corners, width, height) {
  const m = corners / 4;
  return [[1, 0], [0, 1], [-1, 0], [0, -1]].flatMap(([dx, dy]) => range(m).map((i) => {
    const whole = m * m + i * i;
    const [x, y] = turned([m * m - i * i, 2 * m * i], [dx, dy, 1]);
    return [over((x + whole) * width, 2 * whole), over((y + whole) * height, 2 * whole)];
  }));
}

const fan = (corners) => range(corners - 2).flatMap((k) => [0, k + 1, k + 2]);

const zigzag = (corners) => range(corners - 2).flatMap((step) => {
  const left = (step + 1) >> 1, right = corners - 1 - (step >> 1);
  return [left, step % 2 ? right - 1 : left + 1, right];
});

function halved(corners) {
  const found = [], chains = [[0, corners - 1]];
  while (chains.length) {
    const [first, last] = chains.pop();
    if (last - first < 2) continue;
    const middle = (first + last) >> 1;
    found.push(first, middle, last);
    chains.push([middle, last], [first, middle]);
  }
  return found;
}

const inOrder = (points) => ({ points, rows: range(points.length / 2) });

/* The same triangles without shared vertices: each gets three of its own. */
const apart = ({ points, rows }) => inOrder(rows.flatMap((corner) => [points[2 * corner], points[2 * corner + 1]]));

const scattered = (base, height, direction, size, numbers) =>
  inOrder(placed(triangleOf(base, height), [base, height], direction, mixed(...numbers, size)));

/* Base and height of a triangle of an area in px^2 whose base is `aspect` times its height. */
function sidesOf(area, aspect) {
  const doubled = 2 * area * UNIT * UNIT, height = over(Math.sqrt(over(doubled, aspect)), 1);
  return [over(doubled, height), height];
}

const RINGS = [[12, 16, 1], [48, 16, 1], [48, 64, 1], [192, 16, 1], [192, 64, 1], [192, 32, 8]];

function rings(seed, place, cut) {
  const [width, corners, flat] = RINGS[place];
  const size = [width * UNIT, over(width * UNIT, flat)], outline = ringOf(corners, ...size);
  const points = placed(() => outline, size, SLANTED, mixed(seed, 400 + place, Math.max(1, over(MAX_TRIANGLES, corners - 2))));
  const once = cut(corners);
  return { points, rows: range(points.length / 2 / corners).flatMap((copy) => once.map((corner) => corner + copy * corners)) };
}

function strip(seed, number, step, height) {
  const steps = over((SIDE - 8) * UNIT, step), line = steps + 1;
  const bands = Math.min(over(SIDE - 8, height + 2), Math.max(1, over(MAX_TRIANGLES, 2 * steps)));
  const points = mixed(seed, 500 + number, bands * 2 * line).flatMap((stray, k) => {
    const band = over(k, 2 * line), top = over(k, line) % 2;
    return [3 * UNIT + (k % line) * step + stray % (step >> 1),
      (4 + band * (height + 2) + top * height) * UNIT + over(stray, UNIT) % UNIT];
  });
  const rows = range(bands).flatMap((band) => range(steps).flatMap((k) =>
    [k, k + 1, k + line, k + 1, k + 1 + line, k + line].map((corner) => corner + band * 2 * line)));
  return apart({ points, rows });
}

/* Triangles of a mesh of squares; those of a row follow each other in a strip. */
const meshRows = (across, along) => range(across * along).flatMap((k) => {
  const corner = over(k, across) * (across + 1) + k % across, up = corner + across + 1;
  return [corner, corner + 1, up, corner + 1, up + 1, up];
});

/* A mesh of squares of side/256 px, 4 px from 0, whose vertices are moved by less than half a side. */
function jitteredMesh(across, along, side, numbers) {
  const line = across + 1, room = side >> 1;
  const points = numbers.flatMap((number, k) =>
    [(k % line) * side + 4 * UNIT + number % room, over(k, line) * side + 4 * UNIT + over(number, UNIT) % room]);
  return { points, rows: meshRows(across, along) };
}

function mesh(seed, side) {
  const across = Math.min(40, over(SIDE - 8, side));
  return jitteredMesh(across, across, side * UNIT, mixed(seed, 650 + side, (across + 1) ** 2));
}

const alternate = ({ points, rows }) => ({ points, rows: rows.filter((_, k) => over(k, 3) % 2 === 0) });

/* All draws, in order: {points, rows}, flat arrays. */
function makeDesign(seed) {
  const found = [1, 16].map((size, k) => scattered(2048, 2048, SLANTED, size, [seed, k]));
  let number = 100;
  for (const [area, size] of [[8, 1500], [64, 800]]) {
    for (const direction of [LEVEL, SLANTED, DIAGONAL, STEEP]) {
      for (const aspect of [1, 2, 4, 8, 16, 32, 64]) found.push(scattered(...sidesOf(area, aspect), direction, size, [seed, ++number]));
    }
  }
  range(10).forEach((k) => found.push(scattered(64 << k, 64 << k, SLANTED, MAX_TRIANGLES, [seed, 200 + k])));
  [2880, 1440, 720, 360, 180].forEach((size, k) => found.push(scattered(1024 << k, 1024 << k, SLANTED, size, [seed, 300 + k])));
  const small = mixed(seed, 320, 52 * 52).map(triangleOf(1024, 1024));
  for (let start = 0; start < 4; start++) {
    found.push(inOrder(small.flatMap((corners, k) => corners.flatMap(([x, y]) =>
      [x + ((k % 52) * 16 + 96 + start) * UNIT, y + (over(k, 52) * 16 + 96 + start) * UNIT]))));
  }
  RINGS.forEach((_, place) => found.push(...[fan, zigzag, halved].map((cut) => apart(rings(seed, place, cut)))));
  [[256, 16], [1024, 16], [4096, 16], [512, 64]].forEach((size, k) => found.push(strip(seed, k, ...size)));
  const thin = (sizes, directions, first) => sizes.forEach(([length, height, size], k) => directions.forEach((direction, turn) =>
    found.push(scattered(length * UNIT, height, direction, size, [seed, first + k * directions.length + turn]))));
  thin([[64, 16, 2000], [64, 64, 2000], [16, 16, 2000]], [LEVEL, SLANTED], 601);
  thin([[256, 256, 200], [256, 2048, 60], [448, 1024, 40]], [LEVEL, SLANTED, DIAGONAL, STEEP], 621);
  for (const shared of [mesh(seed, 2), mesh(seed, 16), ...[0, 2].map((place) => alternate(rings(seed, place, halved)))]) {
    found.push(shared, apart(shared));
  }
  [[[4096, 4096], 300], [sidesOf(8, 64), 800]].forEach(([size, many], k) => {
    const made = scattered(...size, SLANTED, many, [seed, 700 + k]);
    found.push(made, made, made);
  });
  [[1024, 2000], [8192, 300]].forEach(([side, many], k) => {
    const once = scattered(side, side, SLANTED, many, [seed, 800 + k]);
    found.push(once, { points: once.points, rows: [...once.rows, ...once.rows] });
  });
  [2560, 3072, 3584].forEach((side, k) => found.push(scattered(side, side, SLANTED, 1000, [seed, 210 + k])));
  return [...found, ...makeStageDraws(seed), ...[2, 4].flatMap((side) => [mesh(seed, side), mesh(seed, side)])];
}

/* CRC-32 of the points, then the rows, as 32-bit integers, the low byte first. */
function computeChecksum({ points, rows }) {
  let sum = -1;
  for (const words of [points, rows]) {
    for (const word of words) {
      for (let shift = 0; shift < 32; shift += 8) sum = CRC[(sum ^ (word >>> shift)) & 255] ^ (sum >>> 8);
    }
  }
  return ~sum >>> 0;
}

const CRC = Int32Array.from(range(256), (value) => {
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});
