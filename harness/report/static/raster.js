/* Rasterises a polygon's triangles exactly as the harness counts them: integers on the 1/256 px
   grid, top-left rule (y up), whole 2x2 quads. All products stay below 2^53, so they are exact. */

const UNIT = 256, HALF = 128, LARGEST = 1400;

const startsOf = (counts) => { let sum = 0; return counts.map((count) => (sum += count) - count); };

/* The drawing of a view, its numbers unpacked when first needed. */
function unpackDrawing(view) {
  const { drawing } = view;
  if (!drawing || drawing.ready) return drawing;
  drawing.points = decode(drawing.points, Int32Array);
  drawing.starts = startsOf(drawing.sizes);
  for (const each of Object.values(drawing.triangles)) {
    each.rows = decode(each.rows, Uint32Array);
    each.starts = startsOf(each.counts);
  }
  drawing.ready = true;
  return drawing;
}

/* {points, triangles}: flat arrays of x, y and of three indices; triangles null where not done. */
function polygonOf(drawing, k, name) {
  const first = drawing.starts[k], size = drawing.sizes[k];
  const points = drawing.points.subarray(2 * first, 2 * (first + size));
  const each = drawing.triangles[name];
  const triangles = each?.counts[k] ? each.rows.subarray(3 * each.starts[k], 3 * (each.starts[k] + each.counts[k])) : null;
  return { points, triangles };
}

/* Pixels {left, bottom, width, height} around points, one of margin; at most LARGEST a side. */
function windowOf(points) {
  let [left, bottom, right, top] = [Infinity, Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i += 2) {
    left = Math.min(left, points[i]); right = Math.max(right, points[i]);
    bottom = Math.min(bottom, points[i + 1]); top = Math.max(top, points[i + 1]);
  }
  const low = [left, bottom].map((v) => 2 * Math.floor(v / UNIT / 2) - 2);
  const size = [right, top].map((v, i) => Math.min(LARGEST, Math.ceil(v / UNIT) + 2 - low[i]));
  return { left: low[0], bottom: low[1], width: size[0], height: size[1] };
}

/* Per pixel of the window, row 0 at the bottom: covered lanes, helper lanes, bounding-box tests. */
function shade(points, triangles, { left, bottom, width, height }) {
  const covered = new Uint16Array(width * height), helpers = new Uint16Array(width * height), tests = new Uint16Array(width * height);
  const add = (map, x, y) => { if (x >= left && y >= bottom && x < left + width && y < bottom + height) map[(y - bottom) * width + x - left]++; };
  for (let t = 0; t < triangles.length; t += 3) {
    const corner = [0, 1, 2].map((i) => [points[2 * triangles[t + i]], points[2 * triangles[t + i] + 1]]);
    const [a, b, c] = corner;
    const doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    const range = (i) => {
      const values = corner.map((p) => p[i]);
      return [Math.ceil((Math.min(...values) - HALF) / UNIT), Math.floor((Math.max(...values) - HALF) / UNIT)];
    };
    const [x0, x1] = range(0), [y0, y1] = range(1);
    for (let y = y0; y <= y1; y++) for (let x = x0; x <= x1; x++) add(tests, x, y);
    if (!doubled) continue;
    const ring = doubled > 0 ? [a, b, c] : [a, c, b];
    const edges = ring.map((p, i) => {
      const q = ring[(i + 1) % 3], dx = q[0] - p[0], dy = q[1] - p[1];
      return { p, dx, dy, bias: dy < 0 || (dy === 0 && dx > 0) ? 0 : 1 };
    });
    const inside = (x, y) => edges.every(({ p, dx, dy, bias }) => dx * (UNIT * y + HALF - p[1]) - dy * (UNIT * x + HALF - p[0]) - bias >= 0);
    for (let y = y0 - (y0 & 1); y <= y1; y += 2) {
      for (let x = x0 - (x0 & 1); x <= x1; x += 2) {
        const lanes = [inside(x, y), inside(x + 1, y), inside(x, y + 1), inside(x + 1, y + 1)];
        if (!lanes.includes(true)) continue;
        lanes.forEach((is, lane) => add(is ? covered : helpers, x + (lane & 1), y + (lane >> 1)));
      }
    }
  }
  return { covered, helpers, tests };
}
