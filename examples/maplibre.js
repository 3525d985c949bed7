// MapLibre GL JS: vector tiles of Helsinki, triangulated in workers by earcut and by earcut with flips.

import * as maplibre from "maplibre-gl";
import {recordDraw} from "./record-draw.js";
import {compare} from "./compare.js";

/* global WORKERS, TILES -- from build.mjs: MapLibre's worker with either earcut; tiles by "z/x/y" */

const bytes = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0)).buffer;
maplibre.addProtocol("inside", async ({url}) => ({data: bytes(TILES[url.slice("inside://".length)] ?? "")}));

const style = {
    version: 8,
    sources: {
        helsinki: {
            type: "vector", tiles: ["inside://{z}/{x}/{y}"], minzoom: 15, maxzoom: 15,
            attribution: "© OpenStreetMap contributors",
        },
    },
    layers: ["area", "building"].map((kind) => ({
        id: kind, type: "fill", source: "helsinki", "source-layer": "helsinki", filter: ["==", "kind", kind],
        paint: {"fill-color": kind === "area" ? "#b9d3b0" : "#8a6f5c", "fill-antialias": false},
    })),
};
/** The common vertex of four tiles that fill the canvas: x and y in tiles of zoom 15. */
const CENTRE = [18655, 9485];
const tilesAround = 2 ** 15;
const center = [CENTRE[0] / tilesAround * 360 - 180,
    Math.atan(Math.sinh(Math.PI * (1 - 2 * CENTRE[1] / tilesAround))) * 180 / Math.PI];

async function draw(worker) {
    maplibre.setWorkerUrl(URL.createObjectURL(new Blob([worker], {type: "text/javascript"})));
    const map = new maplibre.Map({
        container: "map", style, center, zoom: 15, pixelRatio: 1, interactive: false, fadeDuration: 0,
    });
    await map.once("idle");
    const gl = map.getCanvas().getContext("webgl2");
    const fill = {attribute: "a_pos", matrices: ["u_projection_matrix"], only: "u_fill_translate"};
    const result = recordDraw(gl, fill, () => map.redraw());
    map.remove(); // removing the last map ends the workers
    return result;
}

compare(await draw(WORKERS.earcut), await draw(WORKERS.flipped));
