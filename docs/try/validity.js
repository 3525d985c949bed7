"use strict";
/* Rings of vertices [x, y] without a closing vertex, and the validity of polygons, which are lists of rings: the exterior first,
   then its holes. Rules and phrases are those of scenes/repair.py (OGC Simple Features, as GEOS applies them). */

/* Twice the signed area of the triangle a, b, c, exact for integers up to 2^25: positive if a, b, c turn left. */
const orientation = ([ax, ay], [bx, by], [cx, cy]) => (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);

const doubledArea = (ring) => ring.reduce((sum, [x, y], i) => {
  const [u, v] = ring[(i + 1) % ring.length];
  return sum + x * v - y * u;
}, 0);

/* Whether a point that is not on a ring is inside the ring: the ray to the right meets an odd number of edges. */
const isInside = (point, ring) => ring.reduce((inside, a, i) => {
  const b = ring[(i + 1) % ring.length];
  const meets = (a[1] > point[1]) !== (b[1] > point[1]) && (orientation(a, b, point) > 0) === (b[1] > a[1]);
  return meets ? !inside : inside;
}, false);

/* Whether all vertices are on one line. */
function isFlat(ring) {
  const [a] = ring, b = ring.find(([x, y]) => x !== a[0] || y !== a[1]) ?? a;
  return ring.every((point) => orientation(a, b, point) === 0);
}

const removeRepeats = (ring) => ring.filter(([x, y], i) => {
  const [u, v] = ring[(i + 1) % ring.length];
  return x !== u || y !== v;
});

/* The rings with a counter-clockwise exterior and clockwise holes. */
const orientRings = (rings) => rings.map((ring, i) => (doubledArea(ring) > 0 === (i === 0) ? ring : [...ring].reverse()));

/* Minimum and maximum of x and y: [left, bottom, right, top]. */
const computeBounds = (points) => points.reduce(([left, bottom, right, top], [x, y]) => [Math.min(left, x), Math.min(bottom, y), Math.max(right, x), Math.max(top, y)],
  [Infinity, Infinity, -Infinity, -Infinity]);

const vertexAt = (ring, index) => ring[(index + ring.length) % ring.length];
const isSamePoint = ([x, y], [u, v]) => x === u && y === v;

/* The edges of all rings, sorted by their left ends. */
function listEdges(rings) {
  const edges = rings.flatMap((ring, r) => ring.map((a, i) => {
    const b = vertexAt(ring, i + 1);
    return { a, b, r, i, bounds: computeBounds([a, b]) };
  }));
  return edges.sort((p, q) => p.bounds[0] - q.bounds[0]);
}

/* The points at which two edges touch, or null if they cross or overlap. The common vertex of consecutive edges is omitted. */
function sharedPoints(p, q, rings) {
  const turns = [orientation(p.a, p.b, q.a), orientation(p.a, p.b, q.b), orientation(q.a, q.b, p.a), orientation(q.a, q.b, p.b)].map(Math.sign);
  const size = rings[p.r].length, isNext = p.r === q.r && q.i === (p.i + 1) % size;
  if (isNext || (p.r === q.r && p.i === (q.i + 1) % size)) {
    const [from, middle, to] = isNext ? [p.a, p.b, q.b] : [q.a, q.b, p.b];
    const dot = (from[0] - middle[0]) * (to[0] - middle[0]) + (from[1] - middle[1]) * (to[1] - middle[1]);
    return orientation(from, middle, to) === 0 && dot > 0 ? null : []; // a spike turns back on itself
  }
  if (turns[0] * turns[1] < 0 && turns[2] * turns[3] < 0) return null;
  const left = Math.max(p.bounds[0], q.bounds[0]), bottom = Math.max(p.bounds[1], q.bounds[1]);
  const right = Math.min(p.bounds[2], q.bounds[2]), top = Math.min(p.bounds[3], q.bounds[3]);
  if (turns.every((sign) => sign === 0) && (left < right || bottom < top)) return null;
  return [q.a, q.b, p.a, p.b].filter(([x, y], k) => turns[k] === 0 && left <= x && x <= right && bottom <= y && y <= top);
}

/* The vertices before and after a point of an edge, along the edge's ring. */
function neighboursAt(point, { a, b, r, i }, rings) {
  if (isSamePoint(point, a)) return [vertexAt(rings[r], i - 1), b];
  return isSamePoint(point, b) ? [a, vertexAt(rings[r], i + 2)] : [a, b];
}

/* Whether two rings that both pass through a point cross there: exactly one neighbour on the second is left of the first. */
function crossesAt(point, [before, after], neighbours) {
  const straight = orientation(point, after, before);
  const isLeft = (other) => {
    const fromAfter = orientation(point, after, other) > 0, toBefore = orientation(point, other, before) > 0;
    if (straight === 0) return fromAfter;
    return straight > 0 ? fromAfter && toBefore : fromAfter || toBefore;
  };
  return isLeft(neighbours[0]) !== isLeft(neighbours[1]);
}

/* { fault, touches }: why the edges of rings make a polygon invalid, or null; and the points where rings touch, each with the
   neighbouring vertices on each ring. */
function findTouches(rings) {
  const edges = listEdges(rings), touches = new Map();
  let fault = null;
  for (const [k, p] of edges.entries()) {
    for (let j = k + 1; j < edges.length && edges[j].bounds[0] <= p.bounds[2]; j++) {
      const q = edges[j];
      if (q.bounds[3] < p.bounds[1] || q.bounds[1] > p.bounds[3]) continue;
      const points = sharedPoints(p, q, rings);
      if (!points) return { fault: "self-intersects", touches };
      for (const point of points) {
        if (p.r === q.r) fault = "touches itself";
        const key = point.join(" "), touch = touches.get(key) ?? { point, rings: new Map() };
        for (const edge of [p, q]) touch.rings.set(edge.r, neighboursAt(point, edge, rings));
        touches.set(key, touch);
      }
    }
  }
  return { fault, touches };
}

/* Whether touching rings enclose a part of the interior: the graph of rings and the points where they touch has a cycle. */
function hasCycle(touches) {
  const parents = new Map();
  const rootOf = (node) => {
    let root = node;
    while (parents.has(root)) root = parents.get(root);
    return root;
  };
  for (const [key, touch] of touches) {
    for (const r of touch.rings.keys()) {
      const roots = [rootOf(key), rootOf(r)];
      if (roots[0] === roots[1]) return true;
      parents.set(roots[0], roots[1]);
    }
  }
  return false;
}

/* Why a polygon of integer coordinates is invalid, as a phrase such as "self-intersects", or null if it is valid. */
function findFault(rings) {
  if (rings.some((ring) => ring.length < 3)) return "has a ring of too few distinct vertices";
  const { fault, touches } = findTouches(rings);
  if (fault) return fault;
  for (const { point, rings: around } of touches.values()) {
    const passing = [...around.values()];
    if (passing.some((one, i) => passing.slice(i + 1).some((other) => crossesAt(point, one, other)))) return "self-intersects";
  }
  const [exterior, ...holes] = rings;
  // Rings do not cross, so one vertex decides, if it is not on the other ring. If there is none, hasCycle reports the rings.
  const isRingInside = (r, s) => {
    const vertex = rings[r].find((point) => !touches.get(point.join(" "))?.rings.has(s));
    return vertex === undefined ? null : isInside(vertex, rings[s]);
  };
  if (holes.some((_, i) => isRingInside(i + 1, 0) === false)) return "has a hole outside its exterior ring";
  if (holes.some((_, i) => holes.some((__, j) => i !== j && isRingInside(i + 1, j + 1)))) return "has nested holes";
  return hasCycle(touches) || isFlat(exterior) ? "has a disconnected interior" : null;
}
