/* Costs of a polygon's triangles per pixel, exactly as the harness counts them. */

const MAX_WINDOW_PX = 1400;

const runningStarts = (counts) => { let sum = 0; return counts.map((count) => (sum += count) - count); };

/* The drawing of a view, unpacked on first use. */
function unpackDrawing(view) {
  const { drawing } = view;
  if (!drawing || drawing.ready) return drawing;
  drawing.points = decode(drawing.points, Int32Array);
  drawing.starts = runningStarts(drawing.sizes);
  for (const each of Object.values(drawing.triangles)) {
    each.rows = decode(each.rows, Uint32Array);
    each.starts = runningStarts(each.counts);
  }
  drawing.ready = true;
  return drawing;
}

/* Polygon k: { points, triangles }, flat arrays of x, y and of vertex indices; triangles is null if the triangulator failed. */
function polygonOf(drawing, k, name) {
  const first = drawing.starts[k], size = drawing.sizes[k];
  const points = drawing.points.subarray(2 * first, 2 * (first + size));
  const each = drawing.triangles[name];
  const triangles = each?.counts[k] ? each.rows.subarray(3 * each.starts[k], 3 * (each.starts[k] + each.counts[k])) : null;
  return { points, triangles };
}

/* Window of pixels {left, bottom, width, height} around points, with a margin; at most MAX_WINDOW_PX per side. */
function windowOf(points) {
  let [left, bottom, right, top] = [Infinity, Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i += 2) {
    left = Math.min(left, points[i]); right = Math.max(right, points[i]);
    bottom = Math.min(bottom, points[i + 1]); top = Math.max(top, points[i + 1]);
  }
  const low = [left, bottom].map((v) => 2 * Math.floor(v / UNIT / 2) - 2);
  const size = [right, top].map((v, i) => Math.min(MAX_WINDOW_PX, Math.ceil(v / UNIT) + 2 - low[i]));
  return { left: low[0], bottom: low[1], width: size[0], height: size[1] };
}

/* Per pixel of the window, row 0 at the bottom: covered lanes, helper lanes, bounding-box tests. */
function shade(points, triangles, { left, bottom, width, height }) {
  const [covered, helpers, tests] = [0, 1, 2].map(() => new Uint16Array(width * height));
  const add = (map, y, first, last) => {
    if (y < bottom || y >= bottom + height) return;
    const row = (y - bottom) * width - left;
    for (let x = Math.max(first, left); x <= Math.min(last, left + width - 1); x++) map[row + x]++;
  };
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = [0, 1, 2].map((i) => [points[2 * triangles[t + i]], points[2 * triangles[t + i] + 1]]);
    const [[x0, x1], [y0, y1]] = [0, 1].map((axis) => pixelRange(corners, axis));
    for (let y = y0; y <= y1; y++) add(tests, y, x0, x1);
    walkTriangle(...corners, (y, ...rows) => {
      const quads = new Set();
      rows.forEach(([first, last], k) => {
        add(covered, y + k, first, last);
        for (let x = first; x <= last; x++) quads.add(x & ~1);
      });
      for (const quad of quads) {
        rows.forEach(([first, last], k) => [quad, quad + 1].filter((x) => x < first || x > last).forEach((x) => add(helpers, y + k, x, x)));
      }
    });
  }
  return { covered, helpers, tests };
}
