"use strict";
/* The page: its state, what is drawn of it, and what people do to it. EXAMPLES are [name, link] pairs. */

const SIZES = [16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512];
const MATTERS = 0.01; // of the lanes that ear clipping shades: less is nothing
const WAYS = [["ears", "Ear clipping", "earcut, as most programs use it"], ["refined", "earcut’s refine", "flips by circles: fewer thin angles"],
  ["flipped", "Flips", "to diagonals with less |dx| + |dy|"], ["optimal", "The optimum for H", "least width + height of all boxes"]];
const SAID = { refined: "earcut’s refine", flipped: "flips after it", optimal: "the optimum for H" };
const SVG = "http://www.w3.org/2000/svg";

const state = { rings: [], size: 64, rotation: 0, chosen: 0, open: null, found: null };
const count = (value) => value.toLocaleString("en-GB");
const share = (value) => `${(100 * value).toFixed(1)} %`;
const cornersOf = (rings) => rings.flatMap((ring, r) => ring.map((_, i) => [r, i]));

/* What all ways make of the polygon as it is, at its size and rotation. */
function measure({ rings, size, rotation }) {
  const placed = place(rings, size, rotation), simple = isSimple(placed);
  const made = triangulations(placed, simple), found = { placed, simple, ways: {} };
  for (const [name] of WAYS) {
    if (!made[name]) continue;
    const shaded = { covered: new Uint8Array(size * size), helpers: new Uint8Array(size * size) };
    found.ways[name] = { rows: made[name], shaded, counts: shade(placed.points, made[name], size, shaded) };
  }
  const base = found.ways.ears.counts.quads;
  for (const way of Object.values(found.ways)) way.saved = base ? 1 - way.counts.quads / base : 0;
  return found;
}

/* What is found, as [text, kind] pieces of one sentence. */
function sentenceOf({ simple, ways, placed }, size) {
  if (!simple) return [["Edges of this polygon cross or touch. Drag a corner until they do not, and its triangles can be compared."]];
  if (placed.points.length === 6) return [["A triangle has one triangulation. Add a corner, and there is something to choose."]];
  const others = Object.keys(SAID).filter((name) => ways[name]);
  if (Math.max(...others.map((name) => ways[name].saved)) < MATTERS) {
    return [[`It does not matter for this polygon at ${size} px: none of these saves 1 % of the lanes that ear clipping shades.`]];
  }
  const pieces = [[`At ${size} px, of the lanes that ear clipping shades, `]];
  others.forEach((name, i) => {
    const { saved } = ways[name], less = saved >= 0;
    if (i) pieces.push([i === others.length - 1 ? " and " : ", "]);
    pieces.push([`${SAID[name]} ${less ? "saves" : "wastes"} `.replace("flips after it saves", "flips after it save").replace("flips after it wastes", "flips after it waste")],
      [less ? share(saved) : `${share(-saved)} more`, less ? "less" : "more"]);
  });
  return [...pieces, ["."]];
}

/* Pixels of a viewport as a picture: covered once, and shaded for nothing once, twice, more often. */
function picture({ covered, helpers }, size, colours) {
  const made = new OffscreenCanvas(size, size), pen = made.getContext("2d"), image = pen.createImageData(size, size);
  for (let y = 0; y < size; y++) {
    for (let x = 0; x < size; x++) {
      const from = y * size + x, at = 4 * ((size - 1 - y) * size + x);
      const colour = helpers[from] ? colours[Math.min(3, helpers[from])] : covered[from] ? colours[0] : null;
      if (colour) image.data.set(colour, at);
    }
  }
  pen.putImageData(image, 0, 0);
  return made;
}

const coloursNow = () => ["--covered", "--one", "--two", "--many"].map((name) => [...numbersOf(styled(name)).slice(0, 3), 255]);

/* Lines between quads, where these are large enough to be seen. */
function drawQuads(pen, side, quad) {
  if (quad < 6 * devicePixelRatio) return;
  pen.strokeStyle = "#888";
  pen.globalAlpha = 0.3;
  pen.beginPath();
  for (let at = quad; at < side - 1; at += quad) {
    const line = Math.round(at) + 0.5;
    pen.moveTo(line, 0);
    pen.lineTo(line, side);
    pen.moveTo(0, line);
    pen.lineTo(side, line);
  }
  pen.stroke();
}

function drawWay(canvas, { rows, shaded }, points, size, colours, edge) {
  const side = Math.round(canvas.clientWidth * devicePixelRatio) || size;
  canvas.width = canvas.height = side;
  const pen = canvas.getContext("2d"), scale = side / size / UNIT;
  pen.imageSmoothingEnabled = side < size;
  pen.drawImage(picture(shaded, size, colours), 0, 0, side, side);
  drawQuads(pen, side, 2 * side / size);
  pen.strokeStyle = edge;
  pen.lineWidth = devicePixelRatio;
  pen.globalAlpha = Math.min(0.8, 0.1 + side / 8 / rows.length); // many edges would hide what they cost
  pen.beginPath();
  for (let t = 0; t < rows.length; t += 3) {
    for (const k of [0, 1, 2]) {
      const [from, to] = [rows[t + k], rows[t + (k + 1) % 3]];
      pen.moveTo(points[2 * from] * scale, side - points[2 * from + 1] * scale);
      pen.lineTo(points[2 * to] * scale, side - points[2 * to + 1] * scale);
    }
  }
  pen.stroke();
}

function whyNone(found) {
  if (!found.simple) return "its edges cross";
  return found.placed.ends.length > 1 ? "raster-harness finds it for polygons with holes; this page does not" : `this page finds it up to ${MOST_FOR_OPTIMUM} corners`;
}

function showWays(found) {
  const colours = coloursNow(), edge = styled("--edge");
  for (const [name] of WAYS) {
    const way = found.ways[name], parts = panels[name];
    parts.canvas.hidden = !way;
    parts.none.hidden = Boolean(way);
    [parts.saved.textContent, parts.saved.className] = name === "ears" ? ["100 %", "base"] : ["", ""];
    if (!way) {
      parts.none.textContent = whyNone(found);
      parts.caption.textContent = "";
      continue;
    }
    const { quads, helper_lanes: helpers, partial_quads: partial, fragments } = way.counts;
    if (name !== "ears" && found.simple) {
      parts.saved.textContent = way.saved === 0 ? "±0 %" : `${way.saved > 0 ? "−" : "+"}${share(Math.abs(way.saved))}`;
      parts.saved.className = way.saved > 0 ? "less" : way.saved < 0 ? "more" : "";
    }
    parts.caption.replaceChildren(element("b", {}, `${count(4 * quads)} lanes`), ` for ${count(fragments)} pixels: ${count(helpers)} helpers, ${count(quads)} quads, ${count(partial)} partial`);
    parts.canvas.setAttribute("aria-label", `${way.counts.triangles} triangles, ${count(helpers)} helper lanes`);
    drawWay(parts.canvas, way, found.placed.points, state.size, colours, edge);
  }
}

function showAnswer(found) {
  $("answer").replaceChildren(...sentenceOf(found, state.size).map(([text, kind]) => (kind ? element("b", { class: kind }, text) : text)));
  const lost = found.placed.lost > 0 ? `, ${found.placed.lost} of which fall together at this size` : "";
  $("corners").textContent = `${count(state.rings.flat().length)} corners${lost}`;
  $("size-told").textContent = `${state.size} px`;
  $("rotation-told").textContent = `${state.rotation}°`;
  $("size").setAttribute("aria-valuetext", `${state.size} pixels`);
}

/* The editor shows 0..GRID as 0..1000, y down. */
const shownAt = ([x, y]) => [1000 * x / GRID, 1000 - 1000 * y / GRID];

function drawn(name, attributes) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function showEditor() {
  const rings = state.open ? [state.open] : state.rings;
  const path = rings.map((ring) => ring.length ? `M${ring.map((point) => shownAt(point).map((value) => value.toFixed(1)).join(" ")).join("L")}${state.open ? "" : "Z"}` : "").join("");
  const parts = [drawn("path", { d: path, class: state.open ? "open" : "area" })];
  const corners = cornersOf(rings), reach = corners.length > 80 ? 7 : corners.length > 30 ? 11 : 15;
  if (!state.open) {
    for (const [r, i] of corners) {
      const [[x1, y1], [x2, y2]] = [rings[r][i], rings[r][(i + 1) % rings[r].length]].map(shownAt);
      parts.push(drawn("line", { x1, y1, x2, y2, class: "grip", "data-edge": `${r} ${i}` }));
    }
  }
  corners.forEach(([r, i], number) => {
    const [cx, cy] = shownAt(rings[r][i]);
    parts.push(drawn("circle", { cx, cy, r: 2.2 * reach, class: "hold", "data-corner": number }), drawn("circle", { cx, cy, r: reach, class: `dot${number === state.chosen ? " chosen" : ""}` }));
  });
  $("editor").replaceChildren(...parts);
  $("editor").classList.toggle("drawing", Boolean(state.open));
  $("draw").setAttribute("aria-pressed", String(Boolean(state.open)));
  $("draw").textContent = state.open ? "Close the polygon" : "Draw your own";
  $("remove").disabled = !state.open && !canRemove();
}

const link = () => toLink(state.rings, state.size, state.rotation);

let waiting = 0;

/* Shows everything anew before the next picture of the screen. */
function changed() {
  waiting ||= requestAnimationFrame(() => {
    waiting = 0;
    showEditor();
    if (state.open) return;
    state.found = measure(state);
    showAnswer(state.found);
    showWays(state.found);
    const { dataset } = document.documentElement;
    if (dataset.ready) history.replaceState(null, "", `#${link()}`); // an address as it was opened stays
    dataset.ready = Number(dataset.ready ?? 0) + 1;
    $("copied").textContent = "";
  });
}

function tell(text) {
  $("notice").textContent = text;
  $("notice").hidden = !text;
}

function take(rings, note = "") {
  Object.assign(state, { rings, chosen: 0, open: null });
  for (const button of $("examples").querySelectorAll("[data-example]")) button.setAttribute("aria-pressed", "false");
  tell(note);
  changed();
}

function takeText(text) {
  try {
    const { rings, note } = readPolygon(text);
    take(rings, note);
  } catch (error) {
    tell(error.message);
  }
}

function takeLink(text) {
  const found = fromLink(decodeURIComponent(text));
  if (!found) return false;
  state.size = SIZES.reduce((best, size) => (Math.abs(size - found.size) < Math.abs(best - found.size) ? size : best));
  state.rotation = found.rotation % 360;
  $("size").value = SIZES.indexOf(state.size);
  $("rotation").value = state.rotation;
  take(found.rings);
  return true;
}

/* What is done to corners. */
const within = (value) => Math.min(GRID, Math.max(0, Math.round(value)));

function chosenCorner() {
  const rings = state.open ? [state.open] : state.rings;
  const [r, i] = cornersOf(rings)[state.chosen] ?? [0, 0];
  return { ring: rings[r], r, i };
}

function choose(number) {
  const corners = cornersOf(state.open ? [state.open] : state.rings).length;
  state.chosen = (number + corners) % (corners || 1);
  const { ring, i } = chosenCorner();
  if (ring[i]) $("corner").textContent = `Corner ${state.chosen + 1} of ${corners} at ${shownAt(ring[i]).map(Math.round).join(", ")}`;
  showEditor();
}

function moveTo(point) {
  const { ring, i } = chosenCorner();
  if (!ring[i]) return;
  ring[i] = point.map(within);
  changed();
}

function insert(r, i, point) {
  state.rings[r].splice(i + 1, 0, point.map(within));
  state.chosen = cornersOf(state.rings).findIndex(([s, k]) => s === r && k === i + 1);
  changed();
}

const canRemove = () => {
  const { ring, r } = chosenCorner();
  return ring.length > 3 || r > 0;
};

function removeCorner() {
  if (state.open) state.open.pop();
  else if (canRemove()) {
    const { ring, r, i } = chosenCorner();
    ring.splice(i, 1);
    if (ring.length < 3) state.rings.splice(r, 1);
    state.chosen = Math.max(0, state.chosen - 1);
  }
  changed();
}

function closeDrawing() {
  const ring = withoutRepeats(state.open);
  if (ring.length < 3 || !doubledArea(ring)) {
    tell("A polygon has three corners or more: click where they are to be.");
    return;
  }
  take(oriented([ring]));
}

function pointOf(event) {
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform($("editor").getScreenCTM().inverse());
  return [x / 1000 * GRID, (1000 - y) / 1000 * GRID];
}

function pressed(event) {
  if (event.button) return;
  const { corner, edge } = event.target.dataset;
  event.preventDefault();
  $("editor").focus({ preventScroll: true });
  if (state.open) {
    if (corner === "0" && state.open.length > 2) closeDrawing();
    else {
      state.open.push(pointOf(event).map(within));
      state.chosen = state.open.length - 1;
      changed();
    }
    return;
  }
  if (corner !== undefined) choose(Number(corner));
  else if (edge !== undefined) insert(...edge.split(" ").map(Number), pointOf(event));
  else return;
  $("editor").setPointerCapture(event.pointerId);
  state.dragging = true;
}

const STEP = GRID / 100;
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function keyPressed(event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const { ring, r, i } = chosenCorner();
  if (KEYS[key] && ring[i]) {
    const step = event.shiftKey ? STEP / 10 : STEP;
    moveTo(ring[i].map((value, axis) => value + step * KEYS[key][axis]));
    choose(state.chosen);
  } else if (key === "n") choose(state.chosen + 1);
  else if (key === "p") choose(state.chosen - 1);
  else if ((key === "Insert" || key === "+") && !state.open) insert(r, i, [0, 1].map((axis) => (ring[i][axis] + ring[(i + 1) % ring.length][axis]) / 2));
  else if (key === "Delete" || key === "Backspace") removeCorner();
  else if (key === "Enter" && state.open) closeDrawing();
  else return;
  event.preventDefault();
}

async function copied(text, what) {
  try {
    await navigator.clipboard.writeText(text);
    $("copied").textContent = `${what} is copied.`;
  } catch {
    $("text").value = text;
    $("text").select();
    $("copied").textContent = `${what} stands in the field for text: copy it there.`;
  }
}

const panels = {};

function build() {
  for (const [name, title, note] of WAYS) {
    const parts = { saved: element("span"), canvas: element("canvas", { role: "img" }), none: element("p", { class: "none", hidden: "" }), caption: element("figcaption") };
    panels[name] = parts;
    $("ways").append(element("figure", { "data-way": name }, element("h3", {}, title, parts.saved), element("div", { class: "quiet" }, note), parts.canvas, parts.none, parts.caption));
  }
  EXAMPLES.forEach(([name, written]) => {
    const button = element("button", { type: "button", "aria-pressed": "false", "data-example": "" }, name);
    button.addEventListener("click", () => {
      const { rings } = fromLink(written);
      take(rings);
      button.setAttribute("aria-pressed", "true");
    });
    $("examples").append(button);
  });
}

function listen() {
  const editor = $("editor");
  editor.addEventListener("pointerdown", pressed);
  editor.addEventListener("pointermove", (event) => { if (state.dragging) moveTo(pointOf(event)); });
  for (const kind of ["pointerup", "pointercancel"]) editor.addEventListener(kind, () => { state.dragging = false; });
  editor.addEventListener("dblclick", () => { if (state.open?.length > 2) closeDrawing(); });
  editor.addEventListener("keydown", keyPressed);
  $("draw").addEventListener("click", () => {
    if (state.open) closeDrawing();
    else {
      state.open = [];
      tell("Click the corners one after another; click the first one again to close the polygon.");
      changed();
    }
  });
  $("remove").addEventListener("click", removeCorner);
  $("text").addEventListener("input", () => { if ($("text").value.trim()) takeText($("text").value); else tell(""); });
  $("size").max = SIZES.length - 1;
  $("size").addEventListener("input", () => { state.size = SIZES[$("size").value]; changed(); });
  $("rotation").addEventListener("input", () => { state.rotation = Number($("rotation").value); changed(); });
  $("copy").addEventListener("click", () => copied(`${location.href.split("#")[0]}#${link()}`, "The link"));
  $("wkt").addEventListener("click", () => copied(toWkt(state.rings), "The polygon"));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", async (event) => {
    event.preventDefault();
    const file = event.dataTransfer.files[0];
    takeText(file ? await file.text() : event.dataTransfer.getData("text"));
  });
  addEventListener("paste", (event) => {
    if (event.target !== $("text")) takeText(event.clipboardData.getData("text"));
  });
  addEventListener("hashchange", () => takeLink(location.hash));
  addEventListener("resize", changed);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
}

build();
listen();
if (!takeLink(location.hash)) {
  takeLink(EXAMPLES[0][1]);
  $("examples").querySelector("[data-example]").setAttribute("aria-pressed", "true");
}
