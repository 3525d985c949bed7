// Show two pictures and count the cost of their triangles with the counter of the harness (spans.js).

/* global countTriangle */

const $ = (id) => document.getElementById(id);
const number = new Intl.NumberFormat("en");

/** Number of triangles, sum of half-perimeters in px, and the pixels, quads and helper lanes of a GPU. */
function measure({points, triangles}) {
    const vertexAt = (index) => [points[2 * index], points[2 * index + 1]];
    const total = {triangles: triangles.length / 3, halfPerimeters: 0, fragments: 0, quads: 0, helperLanes: 0};
    for (let t = 0; t < triangles.length; t += 3) {
        const corners = [0, 1, 2].map((k) => vertexAt(triangles[t + k]));
        for (const axis of [0, 1]) {
            const values = corners.map((vertex) => vertex[axis]);
            total.halfPerimeters += (Math.max(...values) - Math.min(...values)) / 256;
        }
        const [fragments, quads] = countTriangle(...corners);
        total.fragments += fragments;
        total.quads += quads;
    }
    total.helperLanes = 4 * total.quads - total.fragments;
    return total;
}

/** Draw the part of the picture in the page's data-window, magnified, with the edges of triangles. */
function drawPicture(canvas, {size: [width, height], pixels, points, triangles}) {
    const picture = new ImageData(width, height);
    const row = 4 * width;
    for (let y = 0; y < height; y++) picture.data.set(pixels.subarray(y * row, (y + 1) * row), (height - 1 - y) * row);
    const [left, top, side] = canvas.dataset.window.split(" ").map(Number);
    const scale = canvas.width / side, context = canvas.getContext("2d");
    const unscaled = Object.assign(document.createElement("canvas"), {width, height});
    unscaled.getContext("2d").putImageData(picture, 0, 0);
    context.imageSmoothingEnabled = false;
    context.setTransform(scale, 0, 0, scale, -left * scale, -top * scale);
    context.drawImage(unscaled, 0, 0);
    context.lineWidth = 0.7 / scale;
    context.beginPath();
    for (let t = 0; t < triangles.length; t += 3) {
        for (const k of [0, 1, 2]) {
            const index = triangles[t + k];
            context[k ? "lineTo" : "moveTo"](points[2 * index] / 256, height - points[2 * index + 1] / 256);
        }
        context.closePath();
    }
    context.stroke();
}

/** Show both pictures and the table of costs; tests read the global `results`. */
export function compare(before, after) {
    drawPicture($("before"), before);
    drawPicture($("after"), after);
    const totalBefore = measure(before), totalAfter = measure(after);
    let differing = 0;
    for (let i = 0; i < before.pixels.length; i += 4) {
        differing += [0, 1, 2, 3].some((k) => before.pixels[i + k] !== after.pixels[i + k]);
    }
    const rows = {
        triangles: "triangles", halfPerimeters: "sum of width + height of their boxes [px]",
        fragments: "covered pixels", quads: "shaded quads of 2x2 pixels", helperLanes: "helper lanes",
    };
    for (const [key, label] of Object.entries(rows)) {
        const cells = [label, ...[totalBefore[key], totalAfter[key]].map((value) => number.format(Math.round(value))), (totalAfter[key] / totalBefore[key]).toFixed(3)];
        $("figures").insertRow().append(...cells.map((text) => Object.assign(document.createElement("td"), {textContent: text})));
    }
    $("result").textContent = `Flips save ${number.format(totalBefore.helperLanes - totalAfter.helperLanes)} helper lanes. `
        + `${number.format(differing)} of ${number.format(before.pixels.length / 4)} pixels differ.`;
    const result = ({points, triangles}, counted) => ({points, triangles, counted});
    globalThis.results = {before: result(before, totalBefore), after: result(after, totalAfter), differing};
    document.documentElement.dataset.ready = "";
}
