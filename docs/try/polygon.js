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

/* Whether all corners lie on one line. */
const isFlat = (ring) => ring.every(([x, y]) => {
  const [[ax, ay]] = ring, [bx, by] = ring.find(([u, v]) => u !== ax || v !== ay) ?? ring[0];
  return (bx - ax) * (y - ay) === (by - ay) * (x - ax);
});

const withoutRepeats = (ring) => ring.filter(([x, y], i) => {
  const [u, v] = ring[(i + 1) % ring.length];
  return x !== u || y !== v;
});

const turned = (ring, counterClockwise) => (doubledArea(ring) > 0 === counterClockwise ? ring : [...ring].reverse());
const oriented = (rings) => rings.map((ring, i) => turned(ring, i === 0));

/* Polygons as lists of rings, of loose ones: each that lies in no other, or in a hole, is an exterior; those in it are its
   holes. */
function nested(rings) {
  const bySize = [...rings].sort((p, q) => Math.abs(doubledArea(q)) - Math.abs(doubledArea(p)));
  const polygons = [];
  for (const ring of bySize) {
    const owner = polygons.find(([exterior, ...holes]) => isInside(ring[0], exterior) && !holes.some((hole) => isInside(ring[0], hole)));
    if (owner) owner.push(ring);
    else polygons.push([ring]);
  }
  return polygons;
}

const numbersOf = (text) => (text.match(/[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?/gi) ?? []).map(Number);
const inPairs = (numbers, step = 2) => Array.from({ length: Math.floor(numbers.length / step) }, (_, i) => [numbers[step * i], numbers[step * i + 1]]);

/* POLYGON and MULTIPOLYGON: what is in innermost parentheses is a ring; "((" begins a polygon. */
function readWkt(text) {
  if (!/^(?:SRID=\d+;)?\s*(?:MULTI)?POLYGON/i.test(text)) throw new Error("This WKT is no polygon: give a POLYGON ((...)).");
  if (text.split("(").length !== text.split(")").length) throw new Error("This WKT is not whole: a parenthesis is missing.");
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

const MOST_DEGREES = 5; // what is wider is seldom one polygon of a map

/* Whether numbers without a reference system are longitudes and latitudes by their looks: near each other, far from 0. */
function looksLikeDegrees(polygons) {
  const ends = [0, 1].map((axis) => polygons.flat(2).reduce(([low, high], point) => [Math.min(low, point[axis]), Math.max(high, point[axis])], [Infinity, -Infinity]));
  const extent = Math.max(...ends.map(([low, high]) => high - low));
  return extent < MOST_DEGREES && Math.max(...ends.flat().map(Math.abs)) > 10 * extent;
}

const isOnGlobe = (polygons) => polygons.flat(2).every(([x, y]) => Math.abs(x) <= 180 && Math.abs(y) <= 90);

/* How wide a degree of longitude is beside one of latitude, at a polygon's middle. */
function narrowing(rings) {
  const latitudes = rings.flat().map(([, y]) => y);
  const middle = (latitudes.reduce((p, q) => Math.min(p, q)) + latitudes.reduce((p, q) => Math.max(p, q))) / 2;
  return Math.cos(middle * Math.PI / 180);
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

/* The rings of a path's data. */
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
  return nested(rings.map(withoutRepeats).filter((ring) => ring.length > 2));
}

const KINDS = [
  // Whether a text is of the kind, and what reads it.
  [/^[{[]/, readJson],
  [/<(?:path|polygon)\b|^M[\s\d.+-]/i, readSvg],
  [/^(?:SRID=\d+;)?\s*[a-z]{4,}\s*(?:Z|M|ZM)?\s*(?:\(|EMPTY)/i, readWkt],
  [/^[-+\d.\s,;e]+$/i, (text) => [[inPairs(numbersOf(text))]]],
];

function readJson(text) {
  let value;
  try {
    value = JSON.parse(text);
  } catch {
    throw new Error("This is not whole JSON: is its beginning or its end missing?");
  }
  if (!Array.isArray(value)) return readGeoJson(value);
  return [Array.isArray(value[0]?.[0]) ? value : [value]];
}

/* The polygon of a text, the largest one where there are several: { rings, note, back, degrees }.

   degrees : whether its numbers are longitudes and latitudes, as told or else as GeoJSON and EPSG:4326 have them, or as they
     look; null where they cannot be. A polygon of degrees is drawn as wide as it is at its middle
   back : a point of the grid in the text's own numbers
   note : what else was in the text */
function readPolygon(text, told = null) {
  const trimmed = text.trim(), [, read] = KINDS.find(([pattern]) => pattern.test(trimmed)) ?? [];
  if (!read) throw new Error("This is none of WKT (POLYGON ((...))), GeoJSON and an SVG path (M 0 0 L 9 0 ... Z).");
  const polygons = read(trimmed).filter((rings) => rings?.[0]?.length > 2);
  if (!polygons.flat(2).every((point) => Number.isFinite(point?.[0]) && Number.isFinite(point[1]))) throw new Error("A coordinate of this polygon is no number.");
  const degrees = read === readSvg || !isOnGlobe(polygons) ? null : told ?? (trimmed.startsWith("{") || /^SRID=4326;/i.test(trimmed) || looksLikeDegrees(polygons));
  const sized = polygons.filter(([ring]) => !isFlat(ring)).map((rings) => ({ rings, across: degrees ? narrowing(rings) : 1 }));
  if (!sized.length) throw new Error("There is no polygon with an area in this text.");
  const areaOf = ({ rings, across }) => Math.abs(doubledArea(rings[0])) * across;
  const { rings, across } = sized.reduce((best, each) => (areaOf(each) > areaOf(best) ? each : best));
  const [exterior, ...holes] = rings;
  if (holes.some(([point], i) => !isInside(point, exterior) || holes.some((other, j) => i !== j && isInside(point, other)))) {
    throw new Error("A hole of this polygon lies outside it, or in another hole.");
  }
  const corners = rings.flatMap(withoutRepeats).length;
  if (corners > MOST_CORNERS) throw new Error(`It has ${corners} corners; this page draws up to ${MOST_CORNERS}.`);
  return { ...onGrid(rings, across, read === readSvg ? -1 : 1), degrees, note: sized.length > 1 ? `The largest of ${sized.length} polygons.` : "" };
}

/* Rings of any numbers in whole ones, in the middle of 0 to GRID, which the longer side fills; and the way back. */
function onGrid(rings, across, up) {
  const ways = [across, up], points = rings.flat();
  const [left, bottom, right, top] = points.reduce(([l, b, r, t], [x, y]) => [Math.min(l, x), Math.min(b, y), Math.max(r, x), Math.max(t, y)],
    [Infinity, Infinity, -Infinity, -Infinity]);
  const scale = GRID / Math.max((right - left) * across, top - bottom), middle = [(left + right) / 2, (bottom + top) / 2];
  const within = (value) => Math.min(GRID, Math.max(0, Math.round(value))); // far from 0 the middle is not exact
  const whole = rings.map((ring) => withoutRepeats(ring.map((point) => middle.map((at, axis) => within((point[axis] - at) * ways[axis] * scale + GRID / 2)))));
  if (whole[0].length < 3 || isFlat(whole[0])) throw new Error("It is too thin: its corners lie on one line.");
  // One place less than the grid has: a number of the text comes back as it was, unless it has more places.
  const places = Math.min(15, Math.max(0, Math.floor(Math.log10(scale))));
  const back = (point) => middle.map((at, axis) => Number((at + (point[axis] - GRID / 2) / scale / ways[axis]).toFixed(places)));
  return { rings: oriented(whole.filter((ring) => ring.length > 2)), back };
}

const toWkt = (rings, degrees = false) => `${degrees ? "SRID=4326;" : ""}POLYGON (${rings.map((ring) => `(${[...ring, ring[0]].map((point) => point.join(" ")).join(", ")})`).join(", ")})`;

/* A link's end: size, rotation, and the steps from corner to corner, base 36, a sign in the last bit. The last slash tells that
   nothing of it is missing. */
function toLink(rings, size, rotation) {
  let [x, y] = [0, 0];
  const told = (value) => (value < 0 ? -2 * value - 1 : 2 * value).toString(36);
  const written = rings.map((ring) => ring.map(([u, v]) => {
    const step = `${told(u - x)}-${told(v - y)}`;
    [x, y] = [u, v];
    return step;
  }).join("-"));
  return `${size}/${rotation}/${written.join(".")}/`;
}

/* What `toLink` wrote, or null where it is none. */
function fromLink(text) {
  const [, size, rotation, written] = /^#?(\d+)\/(\d+)\/([-.0-9a-z]+)\/$/.exec(text) ?? [];
  if (!written) return null;
  let [x, y] = [0, 0];
  const rings = written.split(".").map((ring) => inPairs(ring.split("-").map((digits) => {
    const value = parseInt(digits, 36);
    return value % 2 ? -(value + 1) / 2 : value / 2;
  })).map(([u, v]) => [x += u, y += v]));
  const points = rings.flat();
  const bad = points.length > MOST_CORNERS || rings.some((ring) => ring.length < 3) || isFlat(rings[0])
    || points.flat().some((value) => !(value >= 0 && value <= GRID));
  return bad ? null : { rings: oriented(rings), size: Number(size), rotation: Number(rotation) };
}
