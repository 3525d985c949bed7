// Time flips, npm's earcut and its refine; see scripts/flips_times.py.

import {readFileSync} from "node:fs";
import {pathToFileURL} from "node:url";
import {join} from "node:path";
import flip from "../../ports/javascript/flip-triangles.js";

const [folder, module, rounds] = process.argv.slice(2);
const {default: earcut, refine} = await import(pathToFileURL(module));
const read = (name, Kind) => {
    const bytes = readFileSync(join(folder, name));
    return new Kind(bytes.buffer, bytes.byteOffset, bytes.byteLength / Kind.BYTES_PER_ELEMENT);
};
const points = read("points.f64", Float64Array), bounds = read("bounds.i32", Int32Array);
const rings = read("rings.i32", Int32Array);
const polygons = [];
for (let i = 2, at = 0; i < bounds.length; i += 2) {
    const data = Array.from(points.subarray(2 * bounds[i - 2], 2 * bounds[i]));
    const ends = Array.from(rings.subarray(at + 1, at + 1 + rings[at]));
    at += 1 + rings[at];
    polygons.push({data, holes: ends.slice(0, -1)});
}
const raw = polygons.map(({data, holes}) => earcut(data, holes));
const candidates = {
    earcut: () => polygons.forEach(({data, holes}) => earcut(data, holes)),
    refine: (copies) => polygons.forEach(({data}, i) => refine(copies[i], data)),
    l1: (copies) => polygons.forEach(({data}, i) => flip(copies[i], data)),
    "l1 native": (copies) => polygons.forEach(({data}, i) => flip(copies[i], data, {order: "native"})),
    quads: (copies) => polygons.forEach(({data}, i) => flip(copies[i], data, {by: "quads", scale: 1})),
    euclidean: (copies) => polygons.forEach(({data}, i) => flip(copies[i], data, {by: "euclidean"})),
    delaunay: (copies) => polygons.forEach(({data}, i) => flip(copies[i], data, {by: "delaunay"})),
};
const minima = {};
for (let round = 0; round < 3 * rounds; round++) {
    for (const [name, run] of Object.entries(candidates)) {
        const copies = raw.map((indices) => indices.slice());
        const start = performance.now();
        run(copies);
        minima[name] = Math.min(minima[name] ?? Infinity, performance.now() - start);
    }
}
console.log(JSON.stringify(minima));
