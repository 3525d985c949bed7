"use strict";
/* The page's state and events. EXAMPLES: list of [name, WKT, side of the viewport in px]; PROFILE: the page that measures a
   device, compressed and in base64. */

const SIZES = [16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512];
const MAX_HISTORY = 200;

/* drawing : vertices of the polygon that is being drawn, or null; cursor: the position of the next vertex
   text : the text from which the polygon was read, or null after an edit; choices: labels of the polygons in the text
   choice : index of the polygon shown; toSource: function from a vertex to coordinates of the text
   degrees : whether the text's coordinates are degrees; result: of comparePolygon; history: earlier polygons for Undo */
const state = { rings: [], size: 64, rotation: 0, selected: 0, example: null, toSource: null, text: null, degrees: null, choices: [], choice: 0, drawing: null, cursor: null, result: null, history: [] };
const listVertexIndices = (rings) => rings.flatMap((ring, r) => ring.map((_, i) => [r, i]));
const currentLink = () => toLink(state.rings, state.size, state.rotation);

let frameRequest = 0;

/* Show the state at the next repaint; several calls before it are one update. */
function requestUpdate() {
  frameRequest ||= requestAnimationFrame(() => {
    frameRequest = 0;
    showEditor();
    dimPanels(Boolean(state.drawing));
    if (!state.drawing) state.result = comparePolygon(state);
    showAnswer(state.result);
    if (state.drawing) return;
    showMethods(state.result);
    const { dataset } = document.documentElement;
    if (dataset.ready) history.replaceState(null, "", `#${currentLink()}`); // the address that was opened stays
    dataset.ready = Number(dataset.ready ?? 0) + 1;
    $("copied").textContent = "";
  });
}

/* Save the polygon for Undo before it changes. */
function saveForUndo() {
  const { rings, example, toSource, text, degrees, choices, choice } = state;
  if (rings.length) state.history.push({ rings: structuredClone(rings), example, toSource, text, degrees, choices, choice });
  state.history.splice(0, state.history.length - MAX_HISTORY);
  Object.assign(state, { example: null, text: null });
}

function undo() {
  if (state.drawing) {
    if (state.drawing.length) removeVertex();
    else cancelDrawing();
    return;
  }
  if (!state.history.length) return;
  Object.assign(state, state.history.pop(), { selected: 0 });
  showNotice("");
  requestUpdate();
}

/* Replace the polygon; the previous polygon is saved for Undo. */
function loadPolygon(rings, { note = "", example = null, toSource = null, text = null, degrees = null, choices = [], choice = 0 } = {}) {
  saveForUndo();
  Object.assign(state, { rings, example, toSource, text, degrees, choices, choice, selected: 0, drawing: null });
  showNotice(note);
  requestUpdate();
}

function loadText(text, degreesGiven = null, choice = 0) {
  if (text.length <= MAX_TEXT_LENGTH && loadLink(text.slice(text.lastIndexOf("#") + 1).trim())) return;
  try {
    const { rings, ...details } = readPolygon(text, degreesGiven, choice);
    loadPolygon(rings, { ...details, text });
  } catch (error) {
    showNotice(`${error.message}${state.drawing ? "" : " The page still shows the previous polygon."}`);
    dimPanels(true);
  }
}

async function loadFile(file) {
  if (file.size > MAX_TEXT_LENGTH) showNotice(`${file.name} has ${format(Math.ceil(file.size / 1e6))} MB; this page reads up to ${MAX_TEXT_LENGTH / 1e6} MB.`);
  else loadText(await file.text());
}

function loadExample(name, text, size) {
  setSize(size);
  loadPolygon(readPolygon(text).rings, { example: name });
}

/* Set the viewport to the element of SIZES that is nearest to `size`. */
function setSize(size) {
  state.size = SIZES.reduce((best, other) => (Math.abs(other - size) < Math.abs(best - size) ? other : best));
  $("size").value = SIZES.indexOf(state.size);
}

function loadLink(text) {
  const link = fromLink(text);
  if (!link) return false;
  setSize(link.size);
  state.rotation = link.rotation;
  $("rotation").value = state.rotation;
  loadPolygon(link.rings);
  return true;
}

/* Load the polygon of the page's address, or report that the link is invalid. */
function loadAddress() {
  if (loadLink(location.hash.replaceAll(/%2f/gi, "/"))) return true;
  if (/^#\d/.test(location.hash)) showNotice("The link to this page is truncated or invalid: the page shows another polygon.");
  return false;
}

/* Editing of vertices. */
const clampToGrid = (value) => Math.min(GRID, Math.max(0, Math.round(value)));

function selectedVertex() {
  const rings = state.drawing ? [state.drawing] : state.rings;
  const [r, i] = listVertexIndices(rings)[state.selected] ?? [0, 0];
  return { ring: rings[r], r, i };
}

function selectVertex(number) {
  const total = listVertexIndices(state.drawing ? [state.drawing] : state.rings).length;
  state.selected = (number + total) % (total || 1);
  const { ring, i } = selectedVertex();
  if (ring[i]) $("announcement").textContent = `Vertex ${state.selected + 1} of ${total} at ${toEditor(ring[i]).map(Math.round).join(", ")}`;
  showEditor();
}

function moveVertex(point) {
  const { ring, i } = selectedVertex();
  if (!ring[i]) return;
  ring[i] = point.map(clampToGrid);
  requestUpdate();
}

/* Insert a vertex after vertex i of ring r; return false if the polygon has the maximum number. */
function insertVertex(r, i, point) {
  if (countVertices(state.rings) >= MAX_VERTICES) {
    showNotice(`This page draws up to ${format(MAX_VERTICES)} vertices.`);
    return false;
  }
  saveForUndo();
  state.rings[r].splice(i + 1, 0, point.map(clampToGrid));
  state.selected = listVertexIndices(state.rings).findIndex(([s, k]) => s === r && k === i + 1);
  requestUpdate();
  return true;
}

function canRemoveVertex() {
  const { ring, r } = selectedVertex();
  return ring.length > 3 || r > 0;
}

function removeVertex() {
  if (state.drawing) state.drawing.pop();
  else if (canRemoveVertex()) {
    saveForUndo();
    const { ring, r, i } = selectedVertex();
    ring.splice(i, 1);
    if (ring.length < 3) state.rings.splice(r, 1);
    state.selected = Math.max(0, state.selected - 1);
  }
  requestUpdate();
}

function closeDrawing() {
  const ring = removeRepeats(state.drawing);
  $("editor").focus({ preventScroll: true });
  if (ring.length < 3 || isFlat(ring)) showNotice("A polygon has three vertices or more, not all on one line.");
  else loadPolygon(orientRings([ring]));
}

function cancelDrawing() {
  state.drawing = null;
  showNotice("");
  requestUpdate();
}

function pointerPosition(event) {
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform($("editor").getScreenCTM().inverse());
  return [x / 1000 * GRID, (1000 - y) / 1000 * GRID];
}

function placeVertex(point) {
  state.drawing.push(point.map(clampToGrid));
  state.selected = state.drawing.length - 1;
  showNotice("");
  requestUpdate();
}

function startDrawing() {
  Object.assign(state, { drawing: [], cursor: null, selected: 0 });
  showNotice("");
  $("editor").focus({ preventScroll: true });
  $("editor").scrollIntoView({ block: "nearest", behavior: "instant" });
  requestUpdate();
}

function onPointerDown(event) {
  if (event.button) return;
  const { vertex, edge } = event.target.dataset;
  event.preventDefault();
  $("editor").focus({ preventScroll: true });
  if (state.drawing) {
    if (event.pointerType === "touch") state.cursor = null; // a finger has no position between two touches
    if (vertex === "0") closeDrawing();
    else placeVertex(pointerPosition(event));
    return;
  }
  if (vertex !== undefined) selectVertex(Number(vertex));
  else if (edge === undefined || !insertVertex(...edge.split(" ").map(Number), pointerPosition(event))) return;
  $("editor").setPointerCapture(event.pointerId);
  state.dragging = vertex === undefined ? "moving" : "pressed";
}

function onPointerMove(event) {
  if (state.dragging) {
    if (state.dragging === "pressed") saveForUndo();
    state.dragging = "moving";
    moveVertex(pointerPosition(event));
  } else if (state.drawing && event.pointerType !== "touch") {
    state.cursor = pointerPosition(event).map(clampToGrid);
    showEditor();
  }
}

const STEP = GRID / 100;
const DIRECTIONS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function onKeyDown(event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if ((event.ctrlKey || event.metaKey) && key === "z") undo();
  else if (event.ctrlKey || event.metaKey || event.altKey || !(state.drawing ? drawByKey : editByKey)(key, event.shiftKey ? STEP / 10 : STEP)) return;
  event.preventDefault();
}

const moveByKey = (point, key, step) => point.map((value, axis) => clampToGrid(value + step * DIRECTIONS[key][axis]));

/* Apply a key while a polygon is drawn; return false if the key has no function. */
function drawByKey(key, step) {
  state.cursor ??= [GRID / 2, GRID / 2];
  if (DIRECTIONS[key]) {
    state.cursor = moveByKey(state.cursor, key, step);
    $("announcement").textContent = `Cross at ${toEditor(state.cursor).map(Math.round).join(", ")}`;
    showEditor();
  } else if (key === " ") placeVertex(state.cursor);
  else if (key === "Enter") closeDrawing();
  else if (key === "Delete" || key === "Backspace") removeVertex();
  else return false;
  return true;
}

/* Apply a key to the selected vertex; return false if the key has no function. */
function editByKey(key, step) {
  const { ring, r, i } = selectedVertex();
  if (DIRECTIONS[key]) {
    saveForUndo();
    moveVertex(moveByKey(ring[i], key, step));
    selectVertex(state.selected);
  } else if (key === "n") selectVertex(state.selected + 1);
  else if (key === "p") selectVertex(state.selected - 1);
  else if (key === "Insert" || key === "+") insertVertex(r, i, [0, 1].map((axis) => (ring[i][axis] + ring[(i + 1) % ring.length][axis]) / 2));
  else if (key === "Delete" || key === "Backspace") removeVertex();
  else return false;
  return true;
}

async function copyText(text, name) {
  try {
    await navigator.clipboard.writeText(text);
    $("copied").textContent = `${name} copied.`;
  } catch {
    $("text").value = text;
    $("text").select();
    $("copied").textContent = `${name} is in the text field: copy it there.`;
  }
}

function copyWkt() {
  const { rings, toSource, degrees } = state;
  copyText(toWkt(toSource ? rings.map((ring) => ring.map(toSource)) : rings, degrees), toSource ? "WKT in the original coordinates" : "WKT in this page’s coordinates");
}

async function savePicture() {
  const blob = await new Promise((resolve) => { drawPicture(state.result).toBlob(resolve); });
  const link = element("a", { href: URL.createObjectURL(blob), download: "triangulations.png" });
  link.click();
  URL.revokeObjectURL(link.href);
  $("copied").textContent = "Picture saved.";
}

/* Open the page of `raster-harness page --profile` in a frame, which measures this device. */
async function measureDevice() {
  $("profile").disabled = true;
  const stream = new Blob([decode(PROFILE, Uint8Array)]).stream().pipeThrough(new DecompressionStream("gzip"));
  const frame = element("iframe", { title: "Cost of a triangle on this device", srcdoc: await new Response(stream).text() });
  frame.addEventListener("load", () => {
    const { documentElement: content } = frame.contentDocument;
    frame.scrollIntoView();
    frame.contentWindow.focus();
    new ResizeObserver(() => { frame.style.height = `${content.offsetHeight + 8}px`; }).observe(content);
  });
  $("profile").parentElement.after(frame);
}

function buildExamples() {
  EXAMPLES.forEach(([name, ...example]) => {
    const button = element("button", { type: "button", "aria-pressed": "false", "data-example": name }, name);
    button.addEventListener("click", () => loadExample(name, ...example));
    $("examples").append(button);
  });
}

function listenToEditor() {
  const editor = $("editor");
  editor.addEventListener("pointerdown", onPointerDown);
  editor.addEventListener("pointermove", onPointerMove);
  for (const kind of ["pointerup", "pointercancel"]) editor.addEventListener(kind, () => { state.dragging = null; });
  editor.addEventListener("dblclick", () => { if (state.drawing?.length > 2) closeDrawing(); });
  editor.addEventListener("keydown", onKeyDown);
  addEventListener("keydown", (event) => { if (event.key === "Escape" && state.drawing) cancelDrawing(); });
}

function listenToControls() {
  $("draw").addEventListener("click", () => { if (state.drawing) closeDrawing(); else startDrawing(); });
  $("notice").addEventListener("click", () => showNotice("")); // the notice covers other content
  $("remove").addEventListener("click", removeVertex);
  $("undo").addEventListener("click", undo);
  $("degrees").addEventListener("change", () => loadText(state.text, $("degrees").checked, state.choice));
  const choose = (choice) => loadText(state.text, state.degrees, choice);
  $("choices").addEventListener("change", () => choose(Number($("choices").value)));
  $("previous").addEventListener("click", () => choose(state.choice - 1));
  $("next").addEventListener("click", () => choose(state.choice + 1));
  $("choose").addEventListener("click", () => $("file").click());
  $("file").addEventListener("change", () => {
    const [file] = $("file").files;
    $("file").value = ""; // so that choosing the same file again is a change
    if (file) loadFile(file);
  });
  $("profile").addEventListener("click", measureDevice);
  $("text").addEventListener("input", () => { if ($("text").value.trim()) loadText($("text").value); else showNotice(""); });
  Object.assign($("size"), { max: SIZES.length - 1, value: SIZES.indexOf(state.size) });
  $("size").addEventListener("input", () => { state.size = SIZES[$("size").value]; requestUpdate(); });
  $("rotation").addEventListener("input", () => { state.rotation = Number($("rotation").value); requestUpdate(); });
  $("copy").addEventListener("click", () => copyText(`${location.href.split("#")[0]}#${currentLink()}`, "Link"));
  $("wkt").addEventListener("click", copyWkt);
  $("picture").addEventListener("click", savePicture);
}

function listenToWindow() {
  const showDropTarget = (isOver) => document.body.classList.toggle("over", isOver);
  addEventListener("dragover", (event) => {
    event.preventDefault();
    showDropTarget(true);
  });
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) showDropTarget(false); });
  addEventListener("drop", (event) => {
    event.preventDefault();
    showDropTarget(false);
    const file = event.dataTransfer.files[0];
    if (file) loadFile(file);
    else loadText(event.dataTransfer.getData("text"));
  });
  addEventListener("paste", (event) => {
    event.preventDefault(); // also in the field: a pasted polygon replaces the text
    const text = event.clipboardData.getData("text");
    if (text.length <= MAX_TEXT_LENGTH) $("text").value = text;
    loadText(text);
  });
  addEventListener("hashchange", loadAddress);
  addEventListener("resize", () => {
    $("answer").style.minHeight = "";
    requestUpdate();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", requestUpdate);
}

buildPanels();
buildExamples();
listenToEditor();
listenToControls();
listenToWindow();
if (!loadAddress()) {
  const notice = $("notice").textContent;
  loadExample(...EXAMPLES[0]);
  showNotice(notice);
}
