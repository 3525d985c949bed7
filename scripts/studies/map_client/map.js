// One vector tile, drawn by MapLibre GL JS at its own zoom: every polygon black, nothing else.

import * as maplibre from "maplibre-gl";

/* global WORKER, PLACE, TILE, LAYERS -- from build.mjs: MapLibre's worker; zoom, x and y; base64; names */

const [zoom, x, y] = PLACE;
const bytes = () => Uint8Array.from(atob(TILE), (each) => each.charCodeAt(0)).buffer;
maplibre.addProtocol("inside", async ({url}) => ({data: url.endsWith(`/${PLACE.join("/")}`) ? bytes() : new ArrayBuffer()}));
maplibre.setWorkerUrl(URL.createObjectURL(new Blob([WORKER], {type: "text/javascript"})));

const turn = 2 ** zoom;
const map = new maplibre.Map({
    container: "map",
    zoom,
    center: [(x + 0.5) / turn * 360 - 180,
        Math.atan(Math.sinh(Math.PI * (1 - 2 * (y + 0.5) / turn))) * 180 / Math.PI],
    style: {
        version: 8,
        sources: {one: {type: "vector", tiles: ["inside://{z}/{x}/{y}"], minzoom: zoom, maxzoom: zoom}},
        layers: LAYERS.map((id) => ({
            id, type: "fill", source: "one", "source-layer": id,
            paint: {"fill-color": "#000", "fill-antialias": false},
        })),
    },
    pixelRatio: 1, interactive: false, fadeDuration: 0, attributionControl: false,
    canvasContextAttributes: {preserveDrawingBuffer: true, antialias: false},
});
await map.once("idle");
document.documentElement.dataset.picture = map.getCanvas().toDataURL();
document.documentElement.dataset.ready = "";
