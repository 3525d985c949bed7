"use strict";
/* A polygon: rings of corners [x, y] in whole numbers from 0 to GRID, y up, none repeated at a ring's end; the first ring
   is the exterior, counter-clockwise, the others are its holes, clockwise. Read from WKT, GeoJSON or SVG; kept in a link. */

const GRID = 2 ** 20;
const MOST_CORNERS = 2000;

const doubledArea = (ring) => ring.reduce((sum, [x, y], i) => {
  const [u, v] = ring[(i + 1) % ring.length];
  return sum + x * v - y * u;
}, 0);

/* Whether a point is inside a ring, by the number of edges to its left. */
const isInside = ([x, y], ring) => ring.reduce((inside, [ax, ay], i) => {
  const [bx, by] = ring[(i + 1) % ring.length];
  return (ay > y) !== (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax) ? !inside : inside;
}, false);

const withoutRepeats = (ring) => ring.filter(([x, y], i) => {
  const [u, v] = ring[(i + 1) % ring.length];
  return x !== u || y !== v;
});

const turned = (ring, counterClockwise) => (doubledArea(ring) > 0 === counterClockwise ? ring : [...ring].reverse());
const oriented = (rings) => rings.map((ring, i) => turned(ring, i === 0));

/* Polygons as lists of rings, of loose ones: each that lies in no other is an exterior, those in it are its holes. */
function nested(rings) {
  const bySize = [...rings].sort((p, q) => Math.abs(doubledArea(q)) - Math.abs(doubledArea(p)));
  const polygons = [];
  for (const ring of bySize) {
    const owner = polygons.find(([exterior]) => isInside(ring[0], exterior));
    if (owner) owner.push(ring);
    else polygons.push([ring]);
  }
  return polygons;
}

const numbersOf = (text) => (text.match(/[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?/gi) ?? []).map(Number);
const inPairs = (numbers, step = 2) => Array.from({ length: Math.floor(numbers.length / step) }, (_, i) => [numbers[step * i], numbers[step * i + 1]]);

/* POLYGON and MULTIPOLYGON: what is in innermost parentheses is a ring; "((" begins a polygon. */
function readWkt(text) {
  const polygons = [];
  for (const [, opening, body] of text.matchAll(/(\(*)\(([^()]*)\)/g)) {
    const ring = body.split(",").map((point) => numbersOf(point).slice(0, 2));
    if (ring.some((point) => point.length < 2)) throw new Error("A corner in this WKT has fewer than two coordinates.");
    if (opening) polygons.push([ring]);
    else polygons.at(-1)?.push(ring);
  }
  return polygons;
}

function readGeoJson(value) {
  if (!value || typeof value !== "object") return [];
  if (value.type === "Polygon") return [value.coordinates];
  if (value.type === "MultiPolygon") return value.coordinates;
  return [value.geometry, ...(value.geometries ?? []), ...(value.features ?? [])].flatMap(readGeoJson);
}

/* Polygons in longitude and latitude, each as wide as it is at its middle. */
function flattened(polygons) {
  if (!polygons.flat(2).every(([x, y]) => Math.abs(x) <= 180 && Math.abs(y) <= 90)) return polygons;
  return polygons.map((rings) => {
    const latitudes = rings.flat().map(([, y]) => y);
    const middle = (latitudes.reduce((p, q) => Math.min(p, q)) + latitudes.reduce((p, q) => Math.max(p, q))) / 2;
    const narrower = Math.cos(middle * Math.PI / 180);
    return rings.map((ring) => ring.map(([x, y]) => [x * narrower, y]));
  });
}

const PIECES = 8; // straight ones of a curve

const bezier = (points) => Array.from({ length: PIECES }, (_, i) => {
  let left = points;
  const t = (i + 1) / PIECES;
  while (left.length > 1) left = left.slice(1).map(([x, y], k) => [left[k][0] + t * (x - left[k][0]), left[k][1] + t * (y - left[k][1])]);
  return left[0];
});

/* An arc from its ends to its centre: SVG 2, appendix B.2.4. */
function arc([x, y], [rx, ry, degrees, large, sweep, u, v]) {
  if (!rx || !ry) return [[u, v]];
  const turn = degrees * Math.PI / 180, cos = Math.cos(turn), sin = Math.sin(turn);
  const px = (cos * (x - u) + sin * (y - v)) / 2, py = (cos * (y - v) - sin * (x - u)) / 2;
  const grow = Math.max(1, Math.hypot(px / rx, py / ry)), a = Math.abs(rx) * grow, b = Math.abs(ry) * grow;
  const apart = Math.sqrt(Math.max(0, 1 / ((px / a) ** 2 + (py / b) ** 2) - 1)) * (large === sweep ? -1 : 1);
  const qx = apart * a * py / b, qy = -apart * b * px / a;
  const from = Math.atan2((py - qy) / b, (px - qx) / a);
  let by = Math.atan2((-py - qy) / b, (-px - qx) / a) - from;
  if (sweep && by < 0) by += 2 * Math.PI;
  if (!sweep && by > 0) by -= 2 * Math.PI;
  return Array.from({ length: PIECES }, (_, i) => {
    const angle = from + by * (i + 1) / PIECES, w = a * Math.cos(angle) + qx, z = b * Math.sin(angle) + qy;
    return i === PIECES - 1 ? [u, v] : [cos * w - sin * z + (x + u) / 2, sin * w + cos * z + (y + v) / 2];
  });
}

const ARGUMENTS = { M: 2, L: 2, H: 1, V: 1, C: 6, S: 4, Q: 4, T: 2, A: 7, Z: 0 };

/* The rings of a path's data, y down as in SVG. */
function readPath(data) {
  const rings = [];
  let ring = [], at = [0, 0], control = null, before = "";
  for (const [, letter, rest] of data.matchAll(/([MLHVCSQTAZ])([^MLHVCSQTAZ]*)/gi)) {
    let kind = letter.toUpperCase();
    const relative = letter !== kind, wanted = ARGUMENTS[kind];
    // An arc's two flags may be written without a space behind them.
    const numbers = kind === "A" ? numbersOf(rest.replaceAll(/((?:[-+.\de]+[\s,]+){3})([01])[\s,]*([01])/gi, "$1 $2 $3 ")) : numbersOf(rest);
    if (kind === "Z") {
      at = ring[0] ?? at;
      before = "Z";
      continue;
    }
    for (let i = 0; i + wanted <= numbers.length; i += wanted) {
      const own = numbers.slice(i, i + wanted), [x, y] = at;
      const points = inPairs(kind === "H" ? [own[0], relative ? 0 : y] : kind === "V" ? [relative ? 0 : x, own[0]] : kind === "A" ? own.slice(5) : own)
        .map(([u, v]) => (relative ? [u + x, v + y] : [u, v]));
      const smooth = control && { S: "SC", T: "TQ" }[kind]?.includes(before) ? [2 * x - control[0], 2 * y - control[1]] : at;
      if (kind === "M" || before === "Z") rings.push(ring = kind === "M" ? [] : [at]);
      if (kind === "C") ring.push(...bezier([at, ...points]));
      else if (kind === "S") ring.push(...bezier([at, smooth, ...points]));
      else if (kind === "Q") ring.push(...bezier([at, ...points]));
      else if (kind === "T") ring.push(...bezier([at, smooth, ...points]));
      else if (kind === "A") ring.push(...arc(at, [...own.slice(0, 5), ...points[0]]));
      else ring.push(points[0]);
      control = kind === "T" ? smooth : points.at(-2) ?? null;
      at = points.at(-1);
      before = kind;
      if (kind === "M") kind = "L"; // further points of a move are lines
    }
  }
  return rings;
}

function readSvg(text) {
  const given = [...text.matchAll(/<(path|polygon)\b[^>]*?\s(?:d|points)\s*=\s*(["'])(.*?)\2/gis)];
  const rings = given.length ? given.flatMap(([, kind, , data]) => (kind.toLowerCase() === "path" ? readPath(data) : [inPairs(numbersOf(data))])) : readPath(text);
  return nested(rings.map((ring) => withoutRepeats(ring).map(([x, y]) => [x, -y])).filter((ring) => ring.length > 2));
}

/* The polygon of a text, the largest one where there are several, and what to say of it: { rings, note }. */
function readPolygon(text) {
  const trimmed = text.trim();
  let polygons;
  if (/^[{[]/.test(trimmed)) {
    let value;
    try {
      value = JSON.parse(trimmed);
    } catch {
      throw new Error("This is not whole JSON: is its beginning or its end missing?");
    }
    polygons = Array.isArray(value) ? [Array.isArray(value[0]?.[0]) ? value : [value]] : flattened(readGeoJson(value));
  } else if (/^\s*(?:SRID=\d+;)?\s*(?:MULTI)?POLYGON/i.test(trimmed)) polygons = readWkt(trimmed);
  else if (/<(?:path|polygon)\b/i.test(trimmed) || /^M[\s\d.+-]/i.test(trimmed)) polygons = readSvg(trimmed);
  else if (/^[-+\d.\s,;e]+$/i.test(trimmed)) polygons = [[inPairs(numbersOf(trimmed))]];
  else throw new Error("This is none of WKT (POLYGON ((...))), GeoJSON and an SVG path (M 0 0 L 9 0 ... Z).");
  const sized = polygons.map((rings) => [Math.abs(doubledArea(rings[0] ?? [])), rings]).filter(([area]) => area > 0);
  if (!sized.length) throw new Error("There is no polygon with an area in this text.");
  const largest = sized.reduce((best, each) => (each[0] > best[0] ? each : best))[1];
  if (largest.flat(2).some((value) => !Number.isFinite(value))) throw new Error("A coordinate of this polygon is no number.");
  const rings = onGrid(largest);
  const corners = rings.flat().length;
  if (corners > MOST_CORNERS) throw new Error(`It has ${corners} corners; this page draws up to ${MOST_CORNERS}.`);
  return { rings, note: sized.length > 1 ? `The largest of ${sized.length} polygons.` : "" };
}

/* Rings of any numbers in whole ones, in the middle of 0 to GRID, which the longer side fills. */
function onGrid(rings) {
  const points = rings.flat();
  const [left, bottom, right, top] = points.reduce(([l, b, r, t], [x, y]) => [Math.min(l, x), Math.min(b, y), Math.max(r, x), Math.max(t, y)],
    [Infinity, Infinity, -Infinity, -Infinity]);
  const scale = GRID / Math.max(right - left, top - bottom), at = (value, low, high) => Math.round((value - (low + high) / 2) * scale + GRID / 2);
  const whole = rings.map((ring) => withoutRepeats(ring.map(([x, y]) => [at(x, left, right), at(y, bottom, top)])));
  if (whole[0].length < 3) throw new Error("It is too thin: its corners lie on one line.");
  return oriented(whole.filter((ring) => ring.length > 2));
}

const toWkt = (rings) => `POLYGON (${rings.map((ring) => `(${[...ring, ring[0]].map((point) => point.join(" ")).join(", ")})`).join(", ")})`;

/* A link's end: size, rotation, and the steps from corner to corner, base 36, a sign in the last bit. */
function toLink(rings, size, rotation) {
  let [x, y] = [0, 0];
  const told = (value) => (value < 0 ? -2 * value - 1 : 2 * value).toString(36);
  const written = rings.map((ring) => ring.map(([u, v]) => {
    const step = `${told(u - x)}-${told(v - y)}`;
    [x, y] = [u, v];
    return step;
  }).join("-"));
  return `${size}/${rotation}/${written.join(".")}`;
}

/* What `toLink` wrote, or null where it is none. */
function fromLink(text) {
  const [, size, rotation, written] = /^#?(\d+)\/(\d+)\/([-.0-9a-z]+)$/.exec(text) ?? [];
  if (!written) return null;
  let [x, y] = [0, 0];
  const rings = written.split(".").map((ring) => inPairs(ring.split("-").map((digits) => {
    const value = parseInt(digits, 36);
    return value % 2 ? -(value + 1) / 2 : value / 2;
  })).map(([u, v]) => [x += u, y += v]));
  const points = rings.flat();
  const bad = points.length > MOST_CORNERS || rings.some((ring) => ring.length < 3) || !doubledArea(rings[0])
    || points.flat().some((value) => !(value >= 0 && value <= GRID));
  return bad ? null : { rings: oriented(rings), size: Number(size), rotation: Number(rotation) };
}
