/* Heatmaps of a polygon with two triangulators, divided by a slider, and a gallery of polygons. */

const heat = { k: 0, maps: {} };
const THUMBNAILS = 12;
const RAMP = ["#ffeda0", "#fed976", "#feb24c", "#fd8d3c", "#fc4e2a", "#e31a1c", "#bd0026", "#800026", "#4a0014"];
const DARK_RAMP = ["#33115c", "#5b1a73", "#872a7c", "#b53679", "#dd5167", "#f47d57", "#fdae5f", "#fbdb82", "#fcffd6"];
const MAPS = { lanes: "lanes shaded", helpers: "helper lanes", tests: "bounding-box tests" };

function currentDrawing() {
  const view = state.report.views[group().view];
  return view ? unpackDrawing(view) : null;
}

/* Counts per pixel of polygon k triangulated by `name`, in the window `at`; null if the triangulator failed. */
function computeMap(k, name) {
  const { points, triangles } = polygonOf(currentDrawing(), k, name);
  if (!triangles) return null;
  const at = windowOf(points);
  const { covered, helpers, tests } = shade(points, triangles, at);
  const kind = $("map").value;
  const values = kind === "tests" ? tests : kind === "helpers" ? helpers : covered.map((v, i) => v + helpers[i]);
  const total = (map) => map.reduce((sum, v) => sum + v, 0);
  return { at, values, points, triangles, fragments: total(covered), helpers: total(helpers), tests: total(tests) };
}

function rampColour(value, most) {
  const ramp = state.dark ? DARK_RAMP : RAMP;
  const level = Math.min(value, ramp.length);
  return ramp[most <= 1 ? 4 : Math.round(((level - 1) * (ramp.length - 1)) / (Math.min(most, ramp.length) - 1))];
}

function paint(canvas, map, most, scale, edges) {
  const { left, bottom, width, height } = map.at;
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  const pen = canvas.getContext("2d");
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const value = map.values[y * width + x];
      if (!value) continue;
      pen.fillStyle = rampColour(value, most);
      const from = [Math.floor(x * scale), Math.floor((height - 1 - y) * scale)];
      pen.fillRect(...from, Math.ceil((x + 1) * scale) - from[0], Math.ceil((height - y) * scale) - from[1]);
    }
  }
  if (!edges) return;
  pen.beginPath();
  for (let t = 0; t < map.triangles.length; t += 3) {
    for (let i = 0; i < 3; i++) {
      const p = map.triangles[t + i];
      const x = (map.points[2 * p] / UNIT - left) * scale, y = (height - (map.points[2 * p + 1] / UNIT - bottom)) * scale;
      if (i) pen.lineTo(x, y); else pen.moveTo(x, y);
    }
    pen.closePath();
  }
  for (const [colour, thick] of state.dark ? [["#000a", 2.5], ["#e8ecf0", 1]] : [["#fffb", 2.5], ["#1b1f24", 1]]) {
    pen.strokeStyle = colour;
    pen.lineWidth = thick;
    pen.stroke();
  }
}

const largest = (values) => values.reduce((most, v) => Math.max(most, v), 1);

function drawHeatmap() {
  const names = [$("left").value, $("right").value];
  const maps = names.map((name) => computeMap(heat.k, name));
  const shown = maps.filter(Boolean);
  const most = Math.max(1, ...shown.map((map) => largest(map.values)));
  heat.maps = Object.fromEntries(names.map((name, i) => [name, maps[i]]));
  const room = Math.min($("compare").parentElement.clientWidth - 2, 720);
  ["canvas-left", "canvas-right"].forEach((id, i) => {
    const map = maps[i] ?? { ...shown[0], values: new Uint16Array(shown[0]?.values.length), triangles: [] };
    if (!map.at) return;
    const scale = Math.max(1, Math.min(room / map.at.width, 520 / map.at.height));
    paint($(id), map, most, scale, true);
    $(id).setAttribute("aria-label", `${names[i]}: ${MAPS[$("map").value]} in each pixel of polygon ${polygonName(heat.k)}`);
  });
  const descriptions = names.map((name, i) => (maps[i]
    ? `${name}: ${number(maps[i].fragments)} fragments, ${number(maps[i].helpers)} helper lanes, ${number(maps[i].tests)} bounding-box tests`
    : `${name} failed on this polygon`));
  const { width, height } = shown[0]?.at ?? { width: 0, height: 0 };
  const cut = Math.max(width, height) === MAX_WINDOW_PX ? ` Only its first ${MAX_WINDOW_PX} px are shown and counted.` : "";
  $("heatmap-caption").replaceChildren(element("strong", {}, `Polygon ${polygonName(heat.k)}`), ` in ${width} × ${height} px, one sample per pixel.${cut}`,
    element("br"), `Left, ${descriptions[0]}.`, element("br"), `Right, ${descriptions[1]}.`);
  drawLegend(most);
  for (const button of $("gallery").children) button.setAttribute("aria-pressed", String(+button.value === heat.k));
}

function drawLegend(most) {
  const levels = Math.min(most, RAMP.length);
  const entries = Array.from({ length: levels }, (_, i) => element("span", {},
    element("i", { style: `background:${rampColour(i + 1, most)}` }), `${i + 1}${i + 1 === levels && most > levels ? " or more" : ""}`));
  $("legend").replaceChildren(`${MAPS[$("map").value]} per pixel:`, ...entries);
}

/* Label of a polygon: the number in the frame, and in the scene if different. */
function polygonName(k) {
  const view = state.report.views[group().view];
  const own = view.sampled[k], source = view.drawing.source[k];
  return own === source ? `${own}` : `${own} (of the scene: ${source})`;
}

function polygonCosts(name) {
  const each = casesOf(state.group).find((c) => c.row.triangulator === name);
  return each?.counted?.[$("measure").value] ?? each?.counted?.[group().main];
}

/* Positions of polygons, in descending order of the cost difference between two triangulators. */
function sortByDifference(a, b) {
  const view = state.report.views[group().view];
  const [p, q] = [polygonCosts(a), polygonCosts(b)];
  const order = view.sampled.map((_, k) => k);
  const gap = (k) => (p && q && view.predicted[a].triangles[k] && view.predicted[b].triangles[k] ? Math.abs(p[k] - q[k]) : -1);
  return order.sort((i, j) => gap(j) - gap(i));
}

function drawGallery() {
  const [a, b] = [$("left").value, $("right").value];
  const [p, q] = [polygonCosts(a), polygonCosts(b)];
  const shown = sortByDifference(a, b).slice(0, THUMBNAILS);
  const maps = shown.map((k) => computeMap(k, b) ?? computeMap(k, a));
  // All thumbnails have the same colour scale.
  const most = maps.reduce((value, map) => (map ? Math.max(value, largest(map.values)) : value), 1);
  $("gallery").replaceChildren(...shown.map((k, i) => {
    const map = maps[i];
    const canvas = element("canvas", { "aria-hidden": "true" });
    if (map) paint(canvas, map, most, Math.max(1, Math.floor(110 / Math.max(map.at.width, map.at.height))), false);
    const counts = p && q ? `${number(p[k])} → ${number(q[k])}` : "";
    const button = element("button", { type: "button", value: k, "aria-pressed": "false" }, canvas, `Polygon ${polygonName(k)}`, element("span", {}, counts));
    button.addEventListener("click", () => { showPolygon(k); });
    return button;
  }));
}

function showPolygon(k) {
  heat.k = k;
  $("polygon").value = String(k);
  drawHeatmap();
}

/* Show the heatmap of polygon k for two triangulators, after a click on a mark. */
function openHeatmap(k, a, b) {
  const drawing = currentDrawing();
  if (drawing) {
    for (const [id, name] of [["left", a], ["right", b]]) if (drawing.triangles[name]) $(id).value = name;
    drawGallery();
    showPolygon(k);
  }
  $("heatmap-title").scrollIntoView();
  $("heatmap-title").focus({ preventScroll: true });
}

function fillHeatmap() {
  const drawing = currentDrawing();
  $("heatmap").hidden = !drawing;
  $("heatmap-section").querySelector(".empty")?.remove();
  if (!drawing) {
    $("heatmap-section").append(element("p", { class: "empty" }, "No heatmap: the run has no drawings of these conditions, as studies store none; raster-harness inspect draws a heatmap."));
    return;
  }
  const names = Object.keys(drawing.triangles);
  const best = ranked(state.group).find((each) => each.complete && each.row.triangulator !== group().base);
  const [a, b] = [group().base, best?.row.triangulator];
  options($("left"), names.map((name) => [name, name]), names.includes(a) ? a : names[0]);
  options($("right"), names.map((name) => [name, name]), names.includes(b) ? b : names.at(-1));
  options($("polygon"), drawing.sizes.map((size, k) => [String(k), `${polygonName(k)}, ${size} vertices`]));
  $("map").value = group().main === "bbox_tests" ? "tests" : "lanes";
  drawGallery();
  showPolygon(sortByDifference($("left").value, $("right").value)[0]);
}

function setUpHeatmap() {
  for (const id of ["left", "right", "map"]) $(id).addEventListener("change", () => { drawGallery(); drawHeatmap(); });
  $("polygon").addEventListener("change", () => showPolygon(+$("polygon").value));
  $("split").addEventListener("input", () => $("compare").style.setProperty("--split", `${$("split").value}%`));
  tables.heatmap = () => {
    const rows = [];
    for (const [name, map] of Object.entries(heat.maps)) {
      map?.values.forEach((value, i) => {
        if (value) rows.push([name, polygonName(heat.k), map.at.left + (i % map.at.width), map.at.bottom + Math.floor(i / map.at.width), value]);
      });
    }
    return csv(["triangulator", "polygon", "x_px", "y_px", $("map").value], rows);
  };
}
