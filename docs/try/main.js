"use strict";
/* The page: its state, what is drawn of it, and what people do to it. EXAMPLES are [name, WKT] pairs; PROFILE is the page that
   measures a device, packed. */

const SIZES = [16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512];
const MATTERS = 0.01; // of the lanes that ear clipping shades: less is nothing
const MOST_BYTES = 20e6;
const MOST_UNDONE = 200;
const WAYS = [["ears", "Ear clipping", "earcut, as most programs use it: what the others are compared with"], ["refined", "earcut’s refine", "flips by circles: fewer thin angles"],
  ["flipped", "Flips", "to diagonals with less |dx| + |dy|"], ["optimal", "The optimum for H", "least width + height of all boxes: good wherever it lies"]];
const SAID = { refined: "earcut’s refine", flipped: "flips", optimal: "the optimum for H" };
const isCoarse = matchMedia("(pointer: coarse)").matches;
const DRAWING = `${isCoarse ? "Touch" : "Click"} where the corners are to be, and the first one again to close the polygon. ${isCoarse ? ""
  : "Keys: arrows move the cross, Space sets a corner, Enter closes, Escape gives up. "}Undo takes the last corner back.`;
const SVG = "http://www.w3.org/2000/svg";

/* open : the corners of a polygon that is being drawn, and cursor where its next one would be
   back : a point in the numbers of the text it came from, which are degrees or not; text : that text, until it is changed
   past : what Undo goes back to */
const state = { rings: [], size: 64, rotation: 0, chosen: 0, example: null, back: null, text: null, degrees: null, open: null, cursor: null, found: null, past: [] };
const count = (value) => value.toLocaleString("en-GB");
const share = (value) => `${(100 * value).toFixed(1)} %`;
const cornersOf = (rings) => rings.flatMap((ring, r) => ring.map((_, i) => [r, i]));

/* What all ways make of the polygon as it is, at its size and rotation. */
function measure({ rings, size, rotation }) {
  const placed = place(rings, size, rotation), simple = isSimple(placed);
  const found = { placed, simple, crosses: !simple && !isSimple({ points: rings.flat(2), ends: endsOf(rings) }), ways: {} };
  if (!simple) return found;
  const made = triangulations(placed);
  for (const [name] of WAYS) {
    if (!made[name]) continue;
    const shaded = { covered: new Uint8Array(size * size), helpers: new Uint8Array(size * size) };
    found.ways[name] = { rows: made[name], shaded, counts: shade(placed.points, made[name], size, shaded) };
  }
  const base = found.ways.ears.counts.quads;
  found.least = Math.min(...Object.values(found.ways).map(({ counts }) => counts.quads));
  for (const way of Object.values(found.ways)) {
    way.saved = base ? 1 - way.counts.quads / base : 0;
    way.cheapest = way.counts.quads === found.least;
  }
  const most = Math.max(...Object.values(found.ways).map(({ counts }) => counts.quads));
  found.matters = most - found.least >= MATTERS * base && base > 0;
  return found;
}

const both = (names) => (names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names[0]);

/* What is found, as [text, kind] pieces of a few sentences. */
function sentenceOf({ simple, crosses, ways, placed, matters }, size) {
  if (crosses) return [["Edges of this polygon cross or touch. Drag a corner until they do not, and its triangles can be compared."]];
  if (!simple) return [[`At ${size} px corners of this polygon fall together, and its edges touch. Draw it larger, and its triangles can be compared.`]];
  if (placed.points.length === 6) return [["A triangle has one triangulation. Add a corner, and there is something to choose."]];
  const others = Object.keys(SAID).filter((name) => ways[name]).sort((p, q) => ways[q].saved - ways[p].saved);
  const told = ({ saved }) => (share(Math.abs(saved)) === share(0) ? ["as many", ""] : saved >= 0 ? [`${share(saved)} fewer`, "less"] : [`${share(-saved)} more`, "more"]);
  const list = (names) => names.flatMap((name, i) => [[`${i ? "; " : ""}${SAID[name]} `], told(ways[name])]);
  const best = ways[others[0]];
  if (!matters) {
    return [[`It does not matter for this polygon at ${size} px: all ways take the same number of lanes, to within 1 %.`]];
  }
  if (best.saved < MATTERS) {
    return [[`At ${size} px none of these saves 1 % of the lanes that ear clipping takes, but some take more: `], ...list(others.filter((name) => -ways[name].saved >= MATTERS)), ["."]];
  }
  const first = others.filter((name) => ways[name].cheapest), rest = others.filter((name) => !ways[name].cheapest);
  const pieces = [[`Cheapest at ${size} px: ${both(first.map((name) => SAID[name]))}, with `], told(best), [" lanes than ear clipping. "]];
  if (rest.length) pieces.push(["Then: "], ...list(rest), ["."]);
  return pieces;
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
  if (!found.simple) return found.crosses ? "its edges cross or touch" : "its edges touch at this size";
  return found.placed.ends.length > 1 ? "raster-harness finds it for polygons with holes; this page does not" : `this page finds it up to ${MOST_FOR_OPTIMUM} corners`;
}

function showWays(found) {
  const colours = coloursNow(), edge = styled("--edge");
  for (const [name] of WAYS) {
    const way = found.ways[name], parts = panels[name];
    parts.canvas.hidden = !way;
    parts.none.hidden = Boolean(way);
    parts.best.hidden = !way?.cheapest || !found.matters;
    [parts.saved.textContent, parts.saved.className] = ["", ""];
    if (!way) {
      parts.none.textContent = whyNone(found);
      parts.caption.textContent = "";
      continue;
    }
    const { quads, helper_lanes: helpers, partial_quads: partial, fragments } = way.counts;
    if (name !== "ears") {
      parts.saved.textContent = way.saved === 0 ? "±0 %" : `${way.saved > 0 ? "−" : "+"}${share(Math.abs(way.saved))}`;
      parts.saved.className = way.saved > 0 ? "less" : way.saved < 0 ? "more" : "";
    }
    parts.caption.replaceChildren(element("b", {}, `${count(4 * quads)} lanes`), ` for ${count(fragments)} pixels: ${count(helpers)} helper lanes; ${count(quads)} quads, ${count(partial)} of them partial`);
    parts.canvas.setAttribute("aria-label", `${way.counts.triangles} triangles, ${count(helpers)} helper lanes`);
    drawWay(parts.canvas, way, found.placed.points, state.size, colours, edge);
  }
}

/* Width and height in px. */
const sidesOf = (points) => [0, 1].map((axis) => {
  const values = points.filter((_, i) => i % 2 === axis);
  return Math.round((Math.max(...values) - Math.min(...values)) / UNIT);
});

function showAnswer(found) {
  const pieces = state.open ? [[DRAWING]] : sentenceOf(found, state.size);
  $("answer").replaceChildren(...pieces.map(([text, kind]) => (kind ? element("b", { class: kind }, text) : text)));
  // It grows and never shrinks: what is below must not move under somebody's finger.
  $("answer").style.minHeight = `${$("answer").offsetHeight}px`;
  $("hint").hidden = Boolean(state.open);
  if (state.open) {
    $("corners").textContent = `${state.open.length} placed so far`;
    return;
  }
  const lost = found.placed.lost > 0 ? `, ${found.placed.lost} of which fall together at this size` : "";
  const [width, height] = sidesOf(found.placed.points);
  $("corners").textContent = `${count(state.rings.flat().length)} corners${lost}, ${width} × ${height} px`;
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
  const shown = state.open && state.cursor ? [[...state.open, state.cursor]] : rings;
  const path = shown.map((ring) => ring.length ? `M${ring.map((point) => shownAt(point).map((value) => value.toFixed(1)).join(" ")).join("L")}${state.open ? "" : "Z"}` : "").join("");
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
    parts.push(drawn("circle", { cx, cy, r: (isCoarse ? 3.6 : 2.2) * reach, class: "hold", "data-corner": number }), drawn("circle", { cx, cy, r: reach, class: `dot${number === state.chosen ? " chosen" : ""}` }));
  });
  if (state.open && state.cursor) {
    const [x, y] = shownAt(state.cursor);
    parts.push(drawn("path", { d: `M${x - 24} ${y}H${x + 24}M${x} ${y - 24}V${y + 24}`, class: "cross" }));
  }
  $("editor").replaceChildren(...parts);
  $("editor").classList.toggle("drawing", Boolean(state.open));
  $("draw").setAttribute("aria-pressed", String(Boolean(state.open)));
  $("draw").textContent = state.open ? "Close the polygon" : "Draw your own";
  $("remove").disabled = state.open ? !state.open.length : !canRemove();
  $("undo").disabled = !state.open && !state.past.length;
  $("copy").disabled = $("wkt").disabled = Boolean(state.open);
  for (const button of $("examples").querySelectorAll("[data-example]")) button.setAttribute("aria-pressed", String(!state.open && button.dataset.example === state.example));
  $("degrees-label").hidden = Boolean(state.open) || state.text === null || state.degrees === null;
  $("degrees").checked = Boolean(state.degrees);
  if (document.activeElement !== $("text")) $("text").value = state.text ?? "";
}

const link = () => toLink(state.rings, state.size, state.rotation);

let waiting = 0;

/* Shows everything anew before the next picture of the screen. */
function changed() {
  waiting ||= requestAnimationFrame(() => {
    waiting = 0;
    showEditor();
    stale(Boolean(state.open));
    if (!state.open) state.found = measure(state);
    showAnswer(state.found);
    if (state.open) return;
    showWays(state.found);
    const { dataset } = document.documentElement;
    if (dataset.ready) history.replaceState(null, "", `#${link()}`); // an address as it was opened stays
    dataset.ready = Number(dataset.ready ?? 0) + 1;
    $("copied").textContent = "";
  });
}

function tell(text) {
  $("copied").textContent = "";
  $("notice").textContent = text;
  $("notice").hidden = !text;
}

/* Pictures and numbers of a polygon that is no longer the one in hand. */
function stale(are) {
  $("ways").classList.toggle("stale", are);
}

/* Keeps the polygon for Undo, before it is changed. */
function remember() {
  const { rings, example, back, text, degrees } = state;
  if (rings.length) state.past.push({ rings: structuredClone(rings), example, back, text, degrees });
  state.past.splice(0, state.past.length - MOST_UNDONE);
  Object.assign(state, { example: null, text: null });
}

function undo() {
  if (state.open) {
    if (state.open.length) removeCorner();
    else giveUp();
    return;
  }
  if (!state.past.length) return;
  Object.assign(state, state.past.pop(), { chosen: 0 });
  tell("");
  changed();
}

/* Takes a polygon in: rings, and what is known of them. */
function take(rings, { note = "", example = null, back = null, text = null, degrees = null } = {}) {
  remember();
  Object.assign(state, { rings, example, back, text, degrees, chosen: 0, open: null });
  tell(note);
  changed();
}

function takeText(text, told = null) {
  if (takeLink(text.slice(text.lastIndexOf("#") + 1).trim())) return;
  try {
    const { rings, ...known } = readPolygon(text, told);
    take(rings, { ...known, text });
  } catch (error) {
    tell(`${error.message}${state.open ? "" : " The polygon shown is the one from before."}`);
    stale(true);
  }
}

async function takeFile(file) {
  if (file.size > MOST_BYTES) tell(`${file.name} has more than ${MOST_BYTES / 1e6} MB: this page is for single polygons.`);
  else takeText(await file.text());
}

const takeExample = (name, text) => take(readPolygon(text).rings, { example: name });

function takeLink(text) {
  const found = fromLink(text);
  if (!found) return false;
  state.size = SIZES.reduce((best, size) => (Math.abs(size - found.size) < Math.abs(best - found.size) ? size : best));
  state.rotation = found.rotation % 360;
  $("size").value = SIZES.indexOf(state.size);
  $("rotation").value = state.rotation;
  take(found.rings);
  return true;
}

/* Takes the polygon of the page's address; says so if it holds only a part of one. */
function takeAddress() {
  if (takeLink(location.hash.replaceAll(/%2f/gi, "/"))) return true;
  if (/^#\d/.test(location.hash)) tell("The link to this page is not whole: the polygon shown is not the one it was made for.");
  return false;
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
  remember();
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
    remember();
    const { ring, r, i } = chosenCorner();
    ring.splice(i, 1);
    if (ring.length < 3) state.rings.splice(r, 1);
    state.chosen = Math.max(0, state.chosen - 1);
  }
  changed();
}

function closeDrawing() {
  const ring = withoutRepeats(state.open);
  $("editor").focus({ preventScroll: true });
  if (ring.length < 3 || isFlat(ring)) tell("A polygon has three corners or more, not all on one line.");
  else take(oriented([ring]));
}

function giveUp() {
  state.open = null;
  tell("");
  changed();
}

function pointOf(event) {
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform($("editor").getScreenCTM().inverse());
  return [x / 1000 * GRID, (1000 - y) / 1000 * GRID];
}

function setCorner(point) {
  state.open.push(point.map(within));
  state.chosen = state.open.length - 1;
  tell("");
  changed();
}

function startDrawing() {
  Object.assign(state, { open: [], cursor: null, chosen: 0 });
  tell("");
  $("editor").focus({ preventScroll: true });
  $("editor").scrollIntoView({ block: "nearest" });
  changed();
}

function pressed(event) {
  if (event.button) return;
  const { corner, edge } = event.target.dataset;
  event.preventDefault();
  $("editor").focus({ preventScroll: true });
  if (state.open) {
    if (event.pointerType === "touch") state.cursor = null; // a finger is nowhere between two touches
    if (corner === "0") closeDrawing();
    else setCorner(pointOf(event));
    return;
  }
  if (corner !== undefined) choose(Number(corner));
  else if (edge !== undefined) insert(...edge.split(" ").map(Number), pointOf(event));
  else return;
  $("editor").setPointerCapture(event.pointerId);
  state.dragging = corner === undefined ? "on" : "begun";
}

function moved(event) {
  if (state.dragging) {
    if (state.dragging === "begun") remember();
    state.dragging = "on";
    moveTo(pointOf(event));
  } else if (state.open && event.pointerType !== "touch") {
    state.cursor = pointOf(event).map(within);
    showEditor();
  }
}

const STEP = GRID / 100;
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function keyPressed(event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if ((event.ctrlKey || event.metaKey) && key === "z") undo();
  else if (event.ctrlKey || event.metaKey || event.altKey || !(state.open ? drawByKey : changeByKey)(key, event.shiftKey ? STEP / 10 : STEP)) return;
  event.preventDefault();
}

const stepped = (point, key, step) => point.map((value, axis) => within(value + step * KEYS[key][axis]));

/* Whether a key does something to the polygon that is being drawn. */
function drawByKey(key, step) {
  state.cursor ??= [GRID / 2, GRID / 2];
  if (KEYS[key]) {
    state.cursor = stepped(state.cursor, key, step);
    $("corner").textContent = `Cross at ${shownAt(state.cursor).map(Math.round).join(", ")}`;
    showEditor();
  } else if (key === " ") setCorner(state.cursor);
  else if (key === "Enter") closeDrawing();
  else if (key === "Delete" || key === "Backspace") removeCorner();
  else return false;
  return true;
}

/* Whether a key does something to the polygon. */
function changeByKey(key, step) {
  const { ring, r, i } = chosenCorner();
  if (KEYS[key]) {
    remember();
    moveTo(stepped(ring[i], key, step));
    choose(state.chosen);
  } else if (key === "n") choose(state.chosen + 1);
  else if (key === "p") choose(state.chosen - 1);
  else if (key === "Insert" || key === "+") insert(r, i, [0, 1].map((axis) => (ring[i][axis] + ring[(i + 1) % ring.length][axis]) / 2));
  else if (key === "Delete" || key === "Backspace") removeCorner();
  else return false;
  return true;
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

/* Has the page that measures a device do so, in a frame of this one. */
async function measureDevice() {
  $("profile").disabled = true;
  const packed = decode(PROFILE, Uint8Array), stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const frame = element("iframe", { title: "What a triangle costs on this device", srcdoc: await new Response(stream).text() });
  frame.addEventListener("load", () => {
    const { documentElement: inside } = frame.contentDocument;
    frame.scrollIntoView();
    frame.contentWindow.focus();
    new ResizeObserver(() => { frame.style.height = `${inside.offsetHeight + 8}px`; }).observe(inside);
  });
  $("profile").parentElement.after(frame);
}

const panels = {};

function build() {
  for (const [name, title, note] of WAYS) {
    const parts = { saved: element("span"), best: element("span", { class: "best", hidden: "" }, "cheapest"), canvas: element("canvas", { role: "img" }), none: element("p", { class: "none", hidden: "" }), caption: element("figcaption") };
    panels[name] = parts;
    $("ways").append(element("figure", { "data-way": name }, element("h3", {}, element("span", {}, title, " ", parts.best), parts.saved), element("div", { class: "quiet" }, note), parts.canvas, parts.none, parts.caption));
  }
  EXAMPLES.forEach(([name, written]) => {
    const button = element("button", { type: "button", "aria-pressed": "false", "data-example": name }, name);
    button.addEventListener("click", () => takeExample(name, written));
    $("examples").append(button);
  });
}

function listen() {
  const editor = $("editor");
  editor.addEventListener("pointerdown", pressed);
  editor.addEventListener("pointermove", moved);
  for (const kind of ["pointerup", "pointercancel"]) editor.addEventListener(kind, () => { state.dragging = null; });
  editor.addEventListener("dblclick", () => { if (state.open?.length > 2) closeDrawing(); });
  editor.addEventListener("keydown", keyPressed);
  addEventListener("keydown", (event) => { if (event.key === "Escape" && state.open) giveUp(); });
  $("draw").addEventListener("click", () => { if (state.open) closeDrawing(); else startDrawing(); });
  $("notice").addEventListener("click", () => tell("")); // it lies over what is below
  $("remove").addEventListener("click", removeCorner);
  $("undo").addEventListener("click", undo);
  $("degrees").addEventListener("change", () => takeText(state.text, $("degrees").checked));
  $("choose").addEventListener("click", () => $("file").click());
  $("file").addEventListener("change", () => { if ($("file").files[0]) takeFile($("file").files[0]); });
  $("profile").addEventListener("click", measureDevice);
  $("text").addEventListener("input", () => { if ($("text").value.trim()) takeText($("text").value); else tell(""); });
  Object.assign($("size"), { max: SIZES.length - 1, value: SIZES.indexOf(state.size) });
  $("size").addEventListener("input", () => { state.size = SIZES[$("size").value]; changed(); });
  $("rotation").addEventListener("input", () => { state.rotation = Number($("rotation").value); changed(); });
  $("copy").addEventListener("click", () => copied(`${location.href.split("#")[0]}#${link()}`, "The link"));
  $("wkt").addEventListener("click", () => copied(toWkt(state.back ? state.rings.map((ring) => ring.map(state.back)) : state.rings, state.degrees), `The polygon, in ${state.back ? "its own units" : "units of this page"},`));
  const over = (is) => document.body.classList.toggle("over", is);
  addEventListener("dragover", (event) => {
    event.preventDefault();
    over(true);
  });
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) over(false); });
  addEventListener("drop", (event) => {
    event.preventDefault();
    over(false);
    const file = event.dataTransfer.files[0];
    if (file) takeFile(file);
    else takeText(event.dataTransfer.getData("text"));
  });
  addEventListener("paste", (event) => {
    event.preventDefault(); // in the field, too: a second polygon takes the place of the first
    $("text").value = event.clipboardData.getData("text");
    takeText($("text").value);
  });
  addEventListener("hashchange", takeAddress);
  addEventListener("resize", () => {
    $("answer").style.minHeight = "";
    changed();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
}

build();
listen();
if (!takeAddress()) {
  const broken = $("notice").textContent;
  takeExample(...EXAMPLES[0]);
  tell(broken);
}
