"use strict";
/* Polygons read from WKT, GeoJSON, SVG or a list of coordinates, and written as WKT and in links. On the page coordinates are
   integers from 0 to GRID, y up; exteriors are counter-clockwise, holes clockwise. */

const GRID = 2 ** 20;
const MAX_TEXT_LENGTH = 20e6;
const MAX_VERTICES = 2000;
const MAX_CHOICES = 300; // polygons of a text that are listed

const format = (value) => value.toLocaleString("en-GB");
const parseNumbers = (text) => (text.match(/[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?/gi) ?? []).map(Number);
const pairUp = (numbers) => Array.from({ length: Math.floor(numbers.length / 2) }, (_, i) => [numbers[2 * i], numbers[2 * i + 1]]);
const countVertices = (rings) => rings.reduce((sum, ring) => sum + ring.length, 0);

/* The polygons of a POLYGON or MULTIPOLYGON: rings are two or three parentheses deep. */
function readWkt(text) {
  const match = /^(?:SRID=\d+;)?\s*(MULTI)?POLYGON/i.exec(text);
  if (!match) throw new Error("This WKT is not a polygon: give a POLYGON ((...)).");
  const polygons = [], ringDepth = match[1] ? 3 : 2;
  let depth = 0;
  for (const [token] of text.slice(text.indexOf("(")).matchAll(/[()]|[^()]+/g)) {
    if (token === "(") {
      depth++;
      if (depth > ringDepth) throw new Error("This WKT is malformed: it has too many opening parentheses.");
      if (depth === ringDepth - 1) polygons.push([]);
    } else if (token === ")") depth--;
    else if (depth === ringDepth) polygons.at(-1).push(token);
    if (depth < 0) throw new Error("This WKT is malformed: it has too many closing parentheses.");
  }
  if (depth) throw new Error("This WKT is truncated: a closing parenthesis is missing.");
  return polygons.map((rings) => rings.map((ring) => ring.split(",").map(readPoint)));
}

function readPoint(text) {
  const values = text.trim().split(/\s+/).map(Number);
  if (values.length < 2) throw new Error("A vertex in this WKT has fewer than two coordinates.");
  return values.slice(0, 2);
}

/* The polygons of GeoJSON, at any depth of collections, in the order of the text. */
function readGeoJson(value) {
  const polygons = [], stack = [value];
  while (stack.length) {
    const item = stack.pop();
    if (!item || typeof item !== "object") continue;
    if (item.type === "Polygon") polygons.push(item.coordinates);
    else if (item.type === "MultiPolygon" && Array.isArray(item.coordinates)) for (const rings of item.coordinates) polygons.push(rings);
    for (const list of [item.features, item.geometries]) {
      if (Array.isArray(list)) for (let i = list.length - 1; i >= 0; i--) stack.push(list[i]);
    }
    stack.push(item.geometry);
  }
  return polygons;
}

function readJson(text) {
  let value;
  try {
    value = JSON.parse(text);
  } catch {
    throw new Error("This is not valid JSON: it may be truncated.");
  }
  if (!Array.isArray(value)) return readGeoJson(value);
  return [Array.isArray(value[0]?.[0]) ? value : [typeof value[0] === "number" ? pairUp(value) : value]];
}

const labelPolygons = (polygons) => ({ polygons: polygons.map((rings, i) => ({ rings, label: `polygon ${i + 1}` })), skipped: [] });

const FORMATS = [
  // A pattern of the text's beginning, and the reader.
  [/^[{[]/, (text) => labelPolygons(readJson(text))],
  [/^(?:<|M[\s\d.+-])/i, readSvg],
  [/^(?:SRID=\d+;)?\s*[a-z]{4,}\s*(?:Z|M|ZM)?\s*(?:\(|EMPTY)/i, (text) => labelPolygons(readWkt(text))],
  [/^[-+\d.\s,;e]+$/i, (text) => labelPolygons([[pairUp(parseNumbers(text))]])],
];

const MAX_EXTENT_IN_DEGREES = 5; // of a single polygon of a map

/* Whether numbers without a reference system look like longitudes and latitudes: close to each other, far from 0. */
function looksLikeDegrees(points) {
  const bounds = computeBounds(points), extent = Math.max(bounds[2] - bounds[0], bounds[3] - bounds[1]);
  return extent < MAX_EXTENT_IN_DEGREES && Math.max(...bounds.map(Math.abs)) > 10 * extent;
}

const isOnGlobe = (points) => points.every(([x, y]) => Math.abs(x) <= 180 && Math.abs(y) <= 90);

/* The length of a degree of longitude relative to a degree of latitude, in the middle of a polygon. */
function longitudeScale(rings) {
  const [, south, , north] = computeBounds(rings.flat());
  return Math.cos((south + north) / 2 * Math.PI / 180);
}

/* Read one polygon of a text: { rings, toSource, degrees, note, choices, choice }.

   choice : index of the polygon among `choices`, the labels of the polygons by decreasing area
   degrees : whether coordinates are longitudes and latitudes: as given, or else by the format (GeoJSON, EPSG:4326), or else by
     their values; null if they cannot be. A polygon in degrees is drawn with the proportions it has on the ground
   toSource : function from a point of the grid to the text's coordinates
   note : sentences about other polygons and skipped elements of the text */
function readPolygon(text, degreesGiven = null, choice = 0) {
  if (text.length > MAX_TEXT_LENGTH) throw new Error(`This text has ${format(text.length)} characters; this page reads up to ${format(MAX_TEXT_LENGTH)}.`);
  const trimmed = text.trim(), [, read] = FORMATS.find(([pattern]) => pattern.test(trimmed)) ?? [];
  if (!read) throw new Error("This is not WKT (POLYGON ((...))), GeoJSON or an SVG path (M 0 0 L 9 0 ... Z).");
  const { polygons, skipped } = read(trimmed), isSvg = read === readSvg;
  const usable = polygons.filter(({ rings }) => rings?.[0]?.length > 2), points = usable.flatMap(({ rings }) => rings.flat(1));
  if (!points.every((point) => Number.isFinite(point?.[0]) && Number.isFinite(point[1]))) throw new Error("A coordinate of this polygon is not a number.");
  const degrees = isSvg || !isOnGlobe(points) ? null : degreesGiven ?? (trimmed.startsWith("{") || /^SRID=4326;/i.test(trimmed) || looksLikeDegrees(points));
  const inLimits = usable.filter(({ rings }) => countVertices(rings) - rings.length <= MAX_VERTICES);
  const sized = inLimits.filter(({ rings }) => !isFlat(rings[0])).map(({ rings, label }) => {
    const xScale = degrees ? longitudeScale(rings) : 1;
    return { rings, label, xScale, area: Math.abs(doubledArea(rings[0])) * xScale };
  }).sort((p, q) => q.area - p.area);
  if (!sized.length) throw makeNoPolygonError(usable, inLimits, skipped);
  const { rings, xScale } = sized[choice] ?? sized[0];
  const notes = [sized.length > 1 ? `${format(sized.length)} polygons: choose one below.` : "", ...describeSkipped(usable.length - inLimits.length, skipped)];
  const choices = sized.slice(0, MAX_CHOICES).map(({ label, rings: listed }) => `${label}: ${countVertices(listed.map(removeRepeats))} vertices`);
  return { ...toGrid(rings, xScale, isSvg ? -1 : 1), degrees, note: notes.filter(Boolean).join(" "), choices, choice };
}

function makeNoPolygonError(usable, inLimits, skipped) {
  if (usable.length > inLimits.length) {
    const [{ rings, label }] = usable.filter((polygon) => !inLimits.includes(polygon));
    return new Error(`${label[0].toUpperCase()}${label.slice(1)} has ${format(countVertices(rings.map(removeRepeats)))} vertices in ${format(rings.length)} ${rings.length > 1 ? "rings" : "ring"}; this page draws up to ${format(MAX_VERTICES)} vertices. raster-harness inspect has no such limit.`);
  }
  return new Error(["There is no polygon with an area in this text.", ...describeSkipped(0, skipped)].join(" "));
}

/* Sentences that name the polygons and elements of a text that were skipped. */
function describeSkipped(oversized, skipped) {
  const counts = new Map();
  for (const reason of skipped) counts.set(reason, (counts.get(reason) ?? 0) + 1);
  const reasons = [...counts].slice(0, 3).map(([reason, number]) => (number > 1 ? `${reason} (${format(number)} times)` : reason));
  return [
    oversized ? `Not listed: ${format(oversized)} of more than ${format(MAX_VERTICES)} vertices.` : "",
    skipped.length ? `Skipped: an element ${reasons.join("; ")}${counts.size > 3 ? "; ..." : ""}.` : "",
  ].filter(Boolean);
}

/* The rings on the grid, centred, with the longer side from 0 to GRID, and the function toSource, which inverts this. */
function toGrid(rings, xScale, ySign) {
  const factors = [xScale, ySign], [left, bottom, right, top] = computeBounds(rings.flat());
  const scale = GRID / Math.max((right - left) * xScale, top - bottom), middle = [(left + right) / 2, (bottom + top) / 2];
  if (!(scale > 0 && Number.isFinite(scale) && middle.every(Number.isFinite))) throw new Error("The coordinates of this polygon are too large or too close together.");
  const clamp = (value) => Math.min(GRID, Math.max(0, Math.round(value))); // the middle is inexact far from 0
  const onGrid = rings.map((ring) => removeRepeats(ring.map((point) => middle.map((at, axis) => clamp((point[axis] - at) * factors[axis] * scale + GRID / 2)))));
  if (onGrid[0].length < 3 || isFlat(onGrid[0])) throw new Error("This polygon is too thin: on the page's grid its vertices are on one line.");
  // One decimal less than the grid resolves: a coordinate of the text comes back unchanged unless it has more decimals.
  const decimals = Math.min(15, Math.max(0, Math.floor(Math.log10(scale))));
  const toSource = (point) => middle.map((at, axis) => Number((at + (point[axis] - GRID / 2) / scale / factors[axis]).toFixed(decimals)));
  return { rings: orientRings(onGrid.filter((ring) => ring.length > 2)), toSource };
}

const toWkt = (rings, degrees = false) => `${degrees ? "SRID=4326;" : ""}POLYGON (${rings.map((ring) => `(${[...ring, ring[0]].map((point) => point.join(" ")).join(", ")})`).join(", ")})`;

/* A link's fragment: size, rotation, and the differences between consecutive vertices in base 36 with the sign in the lowest
   bit. The final slash shows that the link is complete. */
function toLink(rings, size, rotation) {
  let [x, y] = [0, 0];
  const encode = (value) => (value < 0 ? -2 * value - 1 : 2 * value).toString(36);
  const encoded = rings.map((ring) => ring.map(([u, v]) => {
    const step = `${encode(u - x)}-${encode(v - y)}`;
    [x, y] = [u, v];
    return step;
  }).join("-"));
  return `${size}/${rotation}/${encoded.join(".")}/`;
}

/* Read the fragment that `toLink` writes, or return null if it is invalid. */
function fromLink(text) {
  const [, size, rotation, encoded] = /^#?(\d{1,5})\/(\d{1,5})\/([-.0-9a-z]+)\/$/.exec(text) ?? [];
  if (!encoded || encoded.length > 12 * MAX_VERTICES) return null;
  let [x, y] = [0, 0];
  const rings = encoded.split(".").map((ring) => pairUp(ring.split("-").map((digits) => {
    const value = parseInt(digits, 36);
    return value % 2 ? -(value + 1) / 2 : value / 2;
  })).map(([u, v]) => [x += u, y += v]));
  const isInvalid = countVertices(rings) > MAX_VERTICES || rings.some((ring) => ring.length < 3) || isFlat(rings[0])
    || rings.flat(2).some((value) => !(value >= 0 && value <= GRID));
  return isInvalid ? null : { rings: orientRings(rings.map(removeRepeats)), size: Number(size), rotation: Number(rotation) % 360 };
}
