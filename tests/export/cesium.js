// Draw a GLB from above with CesiumJS, as a model or as a vector tile, and return the covered pixels.

import {
    Axis, Cartesian3, Cesium3DTileset, CesiumWidget, Color, Matrix4, Model, OrthographicOffCenterFrustum, Transforms,
} from "@cesium/engine";

const MAX_FRAMES = 3000; // a frame each 10 ms
const FRAMES_AFTER_LOADING = 5;
const frame = Transforms.eastNorthUpToFixedFrame(Cartesian3.fromDegrees(0, 0));

function makeWidget(width, height) {
    document.body.innerHTML = `<style>* { margin: 0 } #view, #view * { width: ${width}px; height: ${height}px }</style><div id="view"></div>`;
    const widget = new CesiumWidget("view", {
        baseLayer: false, globe: false, skyBox: false, skyAtmosphere: false, scene3DOnly: true,
        useDefaultRenderLoop: false, msaaSamples: 1, creditContainer: document.createElement("div"),
        contextOptions: {webgl: {antialias: false, preserveDrawingBuffer: true}},
    });
    widget.scene.backgroundColor = Color.BLACK;
    widget.scene.postProcessStages.fxaa.enabled = false;
    return widget;
}

function lookDown({camera}, [left, bottom, right, top]) {
    const direct = (x, y, z) => Matrix4.multiplyByPointAsVector(frame, new Cartesian3(x, y, z), new Cartesian3());
    camera.frustum = Object.assign(new OrthographicOffCenterFrustum(), {left, right, bottom, top, near: 1, far: 10_000});
    camera.setView({
        destination: Matrix4.multiplyByPoint(frame, new Cartesian3(0, 0, 1000), new Cartesian3()),
        orientation: {direction: direct(0, 0, -1), up: direct(0, 1, 0)},
    });
}

/** A tileset with the GLB as its only tile, read as the draft 3DTILES_content_gltf_vector says. */
function makeTileset(glb) {
    const name = "3DTILES_content_gltf_vector";
    const root = {
        boundingVolume: {sphere: [0, 0, 0, 10_000]}, geometricError: 0, refine: "ADD",
        content: {uri: `data:application/octet-stream;base64,${glb}`}, transform: Matrix4.toArray(frame),
    };
    const tileset = {asset: {version: "1.1"}, extensionsUsed: [name], extensions: {[name]: {}}, geometricError: 1e9, root};
    return URL.createObjectURL(new Blob([JSON.stringify(tileset)], {type: "application/json"}));
}

async function load(glb, asTile, state) {
    if (asTile) {
        const tileset = await Cesium3DTileset.fromUrl(makeTileset(glb));
        tileset.allTilesLoaded.addEventListener(() => { state.loaded = true; });
        tileset.tileFailed.addEventListener(({message}) => { state.failure = message; });
        return tileset;
    }
    const gltf = Uint8Array.from(atob(glb), (character) => character.charCodeAt(0));
    const model = await Model.fromGltfAsync({gltf, modelMatrix: frame, upAxis: Axis.Y, forwardAxis: Axis.X});
    model.readyEvent.addEventListener(() => { state.loaded = true; });
    model.errorEvent.addEventListener((error) => { state.failure = String(error); });
    return model;
}

/** Draw a base64 GLB within bounds; return a string of 0 and 1, row by row from the bottom, or the failure. */
window.draw = async (glb, asTile, bounds, [width, height]) => {
    const state = {};
    const widget = makeWidget(width, height);
    const {scene} = widget;
    scene.primitives.add(await load(glb, asTile, state));
    lookDown(scene, bounds);
    for (let count = 0, left = FRAMES_AFTER_LOADING; left && count < MAX_FRAMES && !state.failure; count++) {
        widget.resize();
        scene.render();
        left -= state.loaded ? 1 : 0;
        await new Promise((resolve) => { setTimeout(resolve, 10); });
    }
    const pixels = new Uint8Array(4 * width * height);
    const gl = scene.context._gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const covered = Array.from({length: width * height}, (_, pixel) => (pixels[4 * pixel] > 0 ? "1" : "0")).join("");
    return {failure: state.failure, loaded: state.loaded, covered};
};
document.documentElement.dataset.ready = "";
