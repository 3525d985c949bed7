"use strict";
/* Filled shapes of SVG drawings, each as a polygon or several, transformed as drawn. scenes/readers/svg.py reads more: clip
   paths, nested drawings and transform origins; here such elements are skipped with a reason. */

const CHORDS = 8; // number of chords that replace a curve, as in scenes/readers/svg_shapes.py
const NUMBER = /[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?/giy;
const SEPARATOR = /[\s,]*/y;

const flattenBezier = (points) => Array.from({ length: CHORDS }, (_, i) => {
  let level = points;
  const t = (i + 1) / CHORDS;
  while (level.length > 1) level = level.slice(1).map(([x, y], k) => [level[k][0] + t * (x - level[k][0]), level[k][1] + t * (y - level[k][1])]);
  return level[0];
});

/* Chords of an elliptical arc after its first point; conversion from end points to the centre: SVG 2, appendix B.2.4. */
function flattenArc([x, y], [rx, ry, degrees, large, sweep, u, v]) {
  if (!rx || !ry) return [[u, v]];
  if (x === u && y === v) return [];
  const tilt = degrees * Math.PI / 180, cos = Math.cos(tilt), sin = Math.sin(tilt);
  const px = (cos * (x - u) + sin * (y - v)) / 2, py = (cos * (y - v) - sin * (x - u)) / 2;
  const growth = Math.max(1, Math.hypot(px / rx, py / ry)), a = Math.abs(rx) * growth, b = Math.abs(ry) * growth;
  const offset = Math.sqrt(Math.max(0, 1 / ((px / a) ** 2 + (py / b) ** 2) - 1)) * (large === sweep ? -1 : 1);
  const qx = offset * a * py / b, qy = -offset * b * px / a;
  const start = Math.atan2((py - qy) / b, (px - qx) / a);
  let angle = Math.atan2((-py - qy) / b, (-px - qx) / a) - start;
  if (sweep && angle < 0) angle += 2 * Math.PI;
  if (!sweep && angle > 0) angle -= 2 * Math.PI;
  const pieces = CHORDS * Math.ceil(Math.abs(angle) / (Math.PI / 2 + 0.001));
  return Array.from({ length: pieces }, (_, i) => {
    const at = start + angle * (i + 1) / pieces, w = a * Math.cos(at) + qx, z = b * Math.sin(at) + qy;
    return i === pieces - 1 ? [u, v] : [cos * w - sin * z + (x + u) / 2, sin * w + cos * z + (y + v) / 2];
  });
}

const ARGUMENTS = { M: "xy", L: "xy", H: "x", V: "y", C: "xyxyxy", S: "xyxy", Q: "xyxy", T: "xy", A: "rrrffxy", Z: "" };

/* The commands of path data as [letter, arguments]; an arc's flags may be written without a separator. */
function* readCommands(data) {
  let at = 0, letter = "";
  const next = (pattern) => {
    pattern.lastIndex = at;
    const match = pattern.exec(data);
    if (match) at += match[0].length;
    return match?.[0];
  };
  for (next(SEPARATOR); at < data.length; next(SEPARATOR)) {
    const command = next(/[MLHVCSQTAZ]/giy);
    if (command || !letter || /Z/i.test(letter)) letter = command;
    if (!letter) throw new Error(`has invalid path data at ${JSON.stringify(data.slice(at, at + 12))}`);
    const values = [...ARGUMENTS[letter.toUpperCase()]].map((kind) => {
      next(SEPARATOR);
      const value = Number(next(kind === "f" ? /[01]/y : NUMBER));
      if (!Number.isFinite(value)) throw new Error(`has invalid path data at ${JSON.stringify(data.slice(at, at + 12))}`);
      return value;
    });
    yield [letter, values];
    if (/M/i.test(letter)) letter = letter === "M" ? "L" : "l"; // further points of a move are lines
  }
}

/* The rings of path data. */
function readPath(data) {
  const rings = [];
  let ring = [], at = [0, 0], control = null, previous = "Z", total = 0;
  for (const [letter, values] of readCommands(data)) {
    const kind = letter.toUpperCase(), [x, y] = letter === kind ? [0, 0] : at;
    if (!rings.length && kind !== "M") throw new Error("has path data that does not begin with M");
    if (kind === "Z") at = ring[0];
    else {
      if (kind === "M" || previous === "Z") rings.push(ring = kind === "M" ? [] : [at]);
      const flat = kind === "H" ? [values[0] + x, at[1]] : kind === "V" ? [at[0], values[0] + y] : values.slice(kind === "A" ? 5 : 0).map((value, k) => value + (k % 2 ? y : x));
      const points = pairUp(flat);
      const reflected = control && { S: "SC", T: "TQ" }[kind]?.includes(previous) ? [2 * at[0] - control[0], 2 * at[1] - control[1]] : at;
      if (kind === "C" || kind === "Q") ring.push(...flattenBezier([at, ...points]));
      else if (kind === "S" || kind === "T") ring.push(...flattenBezier([at, reflected, ...points]));
      else if (kind === "A") ring.push(...flattenArc(at, [...values.slice(0, 5), ...points[0]]));
      else ring.push(points[0]);
      control = kind === "T" ? reflected : points.at(-2) ?? null;
      at = points.at(-1);
    }
    previous = kind;
    total += kind === "C" || kind === "S" || kind === "Q" || kind === "T" || kind === "A" ? CHORDS : 1;
    if (total > MAX_VERTICES) throw new Error(`has more than ${format(MAX_VERTICES)} vertices`);
  }
  return rings;
}

/* Affine matrices [a, b, c, d, e, f]: x' = a x + c y + e, y' = b x + d y + f. */
const IDENTITY = [1, 0, 0, 1, 0, 0];
const multiply = ([a, b, c, d, e, f], [g, h, i, j, k, l]) => [a * g + c * h, b * g + d * h, a * i + c * j, b * i + d * j, a * k + c * l + e, b * k + d * l + f];
const transformRing = ([a, b, c, d, e, f], ring) => ring.map(([x, y]) => [a * x + c * y + e, b * x + d * y + f]);
const radians = (degrees) => degrees * Math.PI / 180;
const makeTranslation = (x, y = 0) => [1, 0, 0, 1, x, y];
const TRANSFORMS = {
  // name: numbers of arguments, matrix
  matrix: [[6], (...values) => values],
  translate: [[1, 2], makeTranslation],
  scale: [[1, 2], (x, y = x) => [x, 0, 0, y, 0, 0]],
  rotate: [[1, 3], (degrees, x = 0, y = 0) => {
    const cos = Math.cos(radians(degrees)), sin = Math.sin(radians(degrees));
    return multiply(multiply(makeTranslation(x, y), [cos, sin, -sin, cos, 0, 0]), makeTranslation(-x, -y));
  }],
  skewX: [[1], (degrees) => [1, 0, Math.tan(radians(degrees)), 1, 0, 0]],
  skewY: [[1], (degrees) => [1, Math.tan(radians(degrees)), 0, 1, 0, 0]],
};
const CSS_TRANSFORMS = {
  ...TRANSFORMS,
  translateX: [[1], makeTranslation],
  translateY: [[1], (y) => makeTranslation(0, y)],
  scaleX: [[1], (x) => [x, 0, 0, 1, 0, 0]],
  scaleY: [[1], (y) => [1, 0, 0, y, 0, 0]],
};
const DEGREES = { rad: 180 / Math.PI, grad: 0.9, turn: 360 };

/* The product of the matrices of a transform list; an unknown function throws an error. */
function readTransform(text, functions) {
  if (text.trim() === "none") return IDENTITY;
  let matrix = IDENTITY;
  const rest = text.replace(/(?<![a-z])([a-z]+)\s*\(([^()]*)\)[\s,]*/gi, (_, name, inner) => {
    const values = [], left = inner.replace(/([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)(px|deg|rad|grad|turn)?[\s,]*/gi, (__, number, unit) => {
      values.push(Number(number) * (DEGREES[unit] ?? 1));
      return "";
    });
    const [counts, matrixOf] = (Object.hasOwn(functions, name) && functions[name]) || [[]];
    if (left.trim() || !counts.includes(values.length)) throw new Error("has an unsupported transform");
    matrix = multiply(matrix, matrixOf(...values));
    return "";
  });
  if (rest.trim()) throw new Error("has an unsupported transform");
  return matrix;
}

const PIXELS = { px: 1, in: 96, cm: 96 / 2.54, mm: 96 / 25.4, pt: 96 / 72, pc: 16 };

/* A length in px, or null if it is absent or "auto". */
function readLength(text) {
  if (text === undefined || text.trim() === "auto") return null;
  const [, number, unit] = /^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*([a-z]*)\s*$/i.exec(text) ?? [];
  const value = Number(number) * (unit ? PIXELS[unit] : 1);
  if (!Number.isFinite(value)) throw new Error("has a length in an unsupported unit");
  return value;
}

/* The rings of a shape element, before its transform. */
function readShape(kind, properties) {
  const length = (name) => readLength(properties[name]) ?? 0;
  if (kind === "path") return readPath(properties.d ?? "");
  if (kind === "polygon" || kind === "polyline") return readPath(/\S/.test(properties.points ?? "") ? `M${properties.points}Z` : "");
  const radius = (name) => (readLength(properties[name]) >= 0 ? readLength(properties[name]) : null);
  const rx = (kind === "circle" ? radius("r") : radius("rx") ?? radius("ry")) ?? 0, ry = (kind === "circle" ? radius("r") : radius("ry") ?? radius("rx")) ?? 0;
  if (kind !== "rect") {
    const x = length("cx"), y = length("cy");
    return rx && ry ? readPath(`M${x - rx} ${y}a${rx} ${ry} 0 1 1 ${2 * rx} 0a${rx} ${ry} 0 1 1 ${-2 * rx} 0Z`) : [];
  }
  const [x, y, width, height] = ["x", "y", "width", "height"].map(length), a = Math.min(rx, width / 2), b = Math.min(ry, height / 2);
  if (width <= 0 || height <= 0) return [];
  if (!a || !b) return [[[x, y], [x + width, y], [x + width, y + height], [x, y + height]]];
  const corner = (u, v) => `a${a} ${b} 0 0 1 ${u} ${v}`;
  return readPath(`M${x + a} ${y}h${width - 2 * a}${corner(a, b)}v${height - 2 * b}${corner(-a, b)}h${2 * a - width}${corner(-a, -b)}v${2 * b - height}${corner(a, -b)}Z`);
}

/* The polygons that the rings of a shape fill, by winding numbers. Rings that cross give one invalid polygon, which the page
   reports. */
function fillRings(rings, rule = "nonzero") {
  const large = rings.map(removeRepeats).filter((ring) => ring.length > 2 && !isFlat(ring));
  if (large.length < 2 || countVertices(large) > MAX_VERTICES) return large.length ? [large] : [];
  const [left, bottom, right, top] = computeBounds(large.flat()), scale = GRID / Math.max(right - left, top - bottom);
  const onIntegers = large.map((ring) => removeRepeats(ring.map(([x, y]) => [Math.round((x - left) * scale), Math.round((y - bottom) * scale)])));
  if (findTouches(onIntegers).fault === "self-intersects") return [large];
  const bySize = [...large].sort((p, q) => Math.abs(doubledArea(p)) - Math.abs(doubledArea(q)));
  const isFilled = (winding) => (rule === "evenodd" ? winding % 2 !== 0 : winding !== 0);
  const polygons = [], holes = [];
  for (const ring of bySize) {
    const outside = bySize.reduce((sum, other) => sum + (other !== ring && isInside(ring[0], other) ? Math.sign(doubledArea(other)) : 0), 0);
    const inside = outside + Math.sign(doubledArea(ring));
    if (isFilled(inside) && !isFilled(outside)) polygons.push([ring]);
    else if (isFilled(outside) && !isFilled(inside)) holes.push(ring);
  }
  for (const hole of holes) polygons.find(([exterior]) => isInside(hole[0], exterior))?.push(hole);
  return polygons;
}

const SHAPES = ["path", "rect", "circle", "ellipse", "polygon", "polyline"];
const SKIPPED_ELEMENTS = { use: "is a copy of another element", text: "is text", flowRoot: "is text", image: "is an image", switch: "is a switch", foreignObject: "is not SVG" };
const decodeEntities = (text) => text.replace(/&(?:#(\d+)|#x([\da-f]+)|(quot|apos|amp|lt|gt));/gi, (_, decimal, hex, name) => (name ? { quot: "\"", apos: "'", amp: "&", lt: "<", gt: ">" }[name.toLowerCase()]
  : String.fromCodePoint(Math.min(0x10ffff, parseInt(decimal ?? hex, decimal ? 10 : 16)))));

/* The tags of XML as { name, attributes, isEnd, isEmpty }, read once from the beginning to the end. */
function* readTags(text) {
  const truncated = new Error("This SVG is truncated: a tag or an element is not closed.");
  const SKIPPED = [["<!--", "-->"], ["<![CDATA[", "]]>"], ["<?", "?>"]];
  for (let at = text.indexOf("<"); at >= 0; at = text.indexOf("<", at)) {
    const [, end] = SKIPPED.find(([begin]) => text.startsWith(begin, at)) ?? [];
    if (end) {
      const close = text.indexOf(end, at);
      if (close < 0) throw truncated;
      at = close + end.length;
      continue;
    }
    let close = at + 1;
    for (let quote = "", depth = 0; quote || depth > 0 || text[close] !== ">"; close++) {
      const letter = text[close];
      if (letter === undefined) throw truncated;
      if (quote) quote = letter === quote ? "" : quote;
      else if (letter === "\"" || letter === "'") quote = letter;
      else if (letter === "[") depth++;
      else if (letter === "]") depth--;
    }
    const tag = text.slice(at + 1, close), [, isEnd, name] = /^(\/?)(?:svg:)?([\w:.-]+)/.exec(tag) ?? [];
    at = close + 1;
    if (!name) continue; // a document type
    const attributes = {};
    for (const [, key, double, single] of tag.matchAll(/(?<![\w:.-])([\w:.-]+)\s*=\s*(?:"([^"]*)"|'([^']*)')/g)) attributes[key] = decodeEntities(double ?? single);
    yield { name, attributes, isEnd: Boolean(isEnd), isEmpty: tag.endsWith("/") };
  }
}

const isZero = (text) => text !== undefined && parseFloat(text) <= 0;
const INVISIBLE_FILL = /^(?:none|transparent|#[\da-f]{3}0|#[\da-f]{6}00|(?:rgb|hsl)a?\((?:[^,/]+,[^,/]+,[^,/]+,|[^,/]+\/)\s*0*(?:\.0*)?%?\s*\))$/i;

/* The state inside an element: matrix, inherited properties, and the reason why its content is skipped, or "". */
function enterElement(outer, { name, attributes }, isRoot) {
  const style = {};
  for (const item of (attributes.style ?? "").split(";")) {
    const colon = item.indexOf(":");
    if (colon > 0) style[item.slice(0, colon).trim()] = item.slice(colon + 1).replace("!important", "").trim();
  }
  const own = { ...attributes, ...style }, inherited = { ...outer.inherited };
  for (const key of ["fill", "fill-rule", "fill-opacity", "visibility", "color"]) if (own[key] && own[key] !== "inherit") inherited[key] = own[key];
  let { matrix, reason } = outer;
  try {
    if (own.transform) matrix = multiply(matrix, readTransform(own.transform, style.transform ? CSS_TRANSFORMS : TRANSFORMS));
  } catch (error) {
    reason ||= error.message;
  }
  if (own["transform-origin"] && own.transform) reason ||= "has a transform-origin";
  if ((own["clip-path"] ?? "none") !== "none") reason ||= "has a clip path";
  if ((own.mask ?? "none") !== "none") reason ||= "has a mask";
  if (own.display === "none") reason ||= "is not displayed";
  if (isZero(own.opacity)) reason ||= "is transparent";
  if (name === "svg" && !isRoot) reason ||= "is in a nested svg element";
  return { name, matrix, inherited, own, reason };
}

/* The reason why a shape has no visible filled area, or "". */
function explainUnfilled({ inherited, reason }) {
  const fill = (inherited.fill ?? "black").trim(), colour = /^currentcolor$/i.test(fill) ? inherited.color ?? "black" : fill;
  if (reason) return reason;
  if (["hidden", "collapse"].includes(inherited.visibility)) return "is not visible";
  return INVISIBLE_FILL.test(colour.trim()) || isZero(inherited["fill-opacity"]) ? "has no visible fill" : "";
}

/* The polygons of a drawing or of bare path data, y down: { polygons: [{ rings, label }], skipped: reasons }. */
function readSvg(text) {
  if (!text.startsWith("<")) return { polygons: fillRings(readBarePath(text)).map((rings, i) => ({ rings, label: `polygon ${i + 1}` })), skipped: [] };
  const polygons = [], skipped = [], stack = [{ name: "", matrix: IDENTITY, inherited: {}, reason: "" }];
  let number = 0;
  for (const tag of readTags(text)) {
    const outer = stack.at(-1);
    if (tag.isEnd) {
      if (outer.name !== tag.name) throw new Error(`This SVG is malformed: </${tag.name}> does not close <${outer.name}>.`);
      stack.pop();
      continue;
    }
    const state = enterElement(outer, tag, stack.length === 1), isShape = SHAPES.includes(tag.name);
    if (outer.isIgnored || !(isShape || ["svg", "g", "a"].includes(tag.name))) state.isIgnored = true;
    if (!tag.isEmpty) stack.push(state);
    if (SKIPPED_ELEMENTS[tag.name] && !outer.isIgnored) skipped.push(SKIPPED_ELEMENTS[tag.name]);
    if (!isShape || state.isIgnored) continue;
    number++;
    const reason = explainUnfilled(state);
    if (reason) skipped.push(reason);
    else {
      try {
        const rings = readShape(tag.name, state.own).map((ring) => transformRing(state.matrix, ring));
        const areas = fillRings(rings, state.inherited["fill-rule"]);
        if (!areas.length) skipped.push("has no area");
        areas.forEach((area) => polygons.push({ rings: area, label: `${tag.name} ${tag.attributes.id ?? number}` }));
      } catch (error) {
        skipped.push(error.message);
      }
    }
  }
  if (stack.length > 1) throw new Error("This SVG is truncated: a tag or an element is not closed.");
  return { polygons, skipped };
}

/* The rings of path data given without an SVG document. */
function readBarePath(data) {
  try {
    return readPath(data);
  } catch (error) {
    throw new Error(`This SVG path ${error.message}.`);
  }
}
