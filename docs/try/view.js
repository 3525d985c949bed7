"use strict";
/* Display of `state` (main.js): panels, editor and texts. */

const SVG = "http://www.w3.org/2000/svg";
const isCoarse = matchMedia("(pointer: coarse)").matches;
const DRAWING_HELP = `${isCoarse ? "Touch" : "Click"} to place vertices, and the first vertex again to close. ${isCoarse ? "Undo removes the last vertex."
  : "Keys: arrows move the cross, Space places a vertex, Enter closes, Escape cancels, Delete removes the last."}`; // two lines: the editor must not move

const panels = {};

/* An image of a viewport: covered pixels, and pixels with one, two or more helper lanes. */
function makeImage({ covered, helpers }, size, colours) {
  const canvas = new OffscreenCanvas(size, size), context = canvas.getContext("2d"), image = context.createImageData(size, size);
  for (let y = 0; y < size; y++) {
    for (let x = 0; x < size; x++) {
      const pixel = y * size + x;
      const colour = helpers[pixel] ? colours[Math.min(3, helpers[pixel])] : covered[pixel] ? colours[0] : null;
      if (colour) image.data.set(colour, 4 * ((size - 1 - y) * size + x));
    }
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

const readColours = () => ["--covered", "--one", "--two", "--many"].map((name) => [...parseNumbers(styled(name)).slice(0, 3), 255]);

/* Draw the grid of quads (side `quad` px of the canvas) if it is wide enough to be visible. */
function drawQuads(context, side, quad) {
  if (quad < 6 * devicePixelRatio) return;
  context.strokeStyle = "#888";
  context.globalAlpha = 0.3;
  context.beginPath();
  for (let at = quad; at < side - 1; at += quad) {
    const line = Math.round(at) + 0.5;
    context.moveTo(line, 0);
    context.lineTo(line, side);
    context.moveTo(0, line);
    context.lineTo(side, line);
  }
  context.stroke();
}

function drawMethod(canvas, { triangles, shaded }, points, size, colours, edgeColour) {
  const side = Math.round(canvas.clientWidth * devicePixelRatio) || size;
  canvas.width = canvas.height = side;
  const context = canvas.getContext("2d"), scale = side / size / UNIT;
  context.imageSmoothingEnabled = side < size;
  context.drawImage(makeImage(shaded, size, colours), 0, 0, side, side);
  drawQuads(context, side, 2 * side / size);
  context.strokeStyle = edgeColour;
  context.lineWidth = devicePixelRatio;
  context.globalAlpha = Math.min(0.8, 0.1 + side / 8 / triangles.length); // opaque edges of many triangles would hide the lanes
  context.beginPath();
  for (let t = 0; t < triangles.length; t += 3) {
    for (const k of [0, 1, 2]) {
      const [from, to] = [triangles[t + k], triangles[t + (k + 1) % 3]];
      context.moveTo(points[2 * from] * scale, side - points[2 * from + 1] * scale);
      context.lineTo(points[2 * to] * scale, side - points[2 * to + 1] * scale);
    }
  }
  context.stroke();
}

function showMethods(result) {
  const colours = readColours(), edgeColour = styled("--edge");
  for (const [name] of METHODS) {
    const method = result.methods[name], panel = panels[name];
    panel.canvas.hidden = !method;
    panel.missing.hidden = Boolean(method);
    panel.best.hidden = !method?.isBest || !result.isDifferent;
    [panel.saving.textContent, panel.saving.className] = ["", ""];
    if (!method) {
      panel.missing.textContent = explainMissing(result);
      panel.caption.textContent = "";
      continue;
    }
    const { triangles, covering_triangles: covering, quads, helper_lanes: helpers, fragments, vertex_batches: batches } = method.counts;
    if (name !== "ears") {
      panel.saving.textContent = formatSaving(method.saving);
      panel.saving.className = method.saving > 0 ? "less" : method.saving < 0 ? "more" : "";
    }
    panel.caption.replaceChildren(element("b", {}, `${format(4 * quads)} lanes`), ` for ${format(fragments)} pixels: ${format(helpers)} helper lanes; ${format(quads)} quads; ${format(covering)} of ${format(triangles)} triangles cover a pixel; ${format(batches)} vertex ${batches === 1 ? "batch" : "batches"}`);
    panel.canvas.setAttribute("aria-label", `${triangles} triangles, ${format(helpers)} helper lanes`);
    drawMethod(panel.canvas, method, result.placed.points, state.size, colours, edgeColour);
  }
}

const formatSaving = (saving) => (saving === 0 ? "±0 %" : `${saving > 0 ? "−" : "+"}${formatPercent(Math.abs(saving))}`);

const PICTURE = { cell: 400, gap: 24, line: 26 };

/* A picture of all triangulations with the answer, to share. */
function drawPicture(result) {
  const { cell, gap, line } = PICTURE, shown = METHODS.filter(([name]) => result.methods[name]);
  const columns = Math.min(3, shown.length), width = columns * (cell + gap) + gap, rowHeight = cell + 3 * line + gap;
  const canvas = element("canvas"), context = canvas.getContext("2d");
  const answer = wrapText(context, $("answer").textContent, width - 2 * gap, `20px ${getComputedStyle(document.body).fontFamily}`);
  const top = gap + (answer.length + 0.5) * line;
  Object.assign(canvas, { width, height: top + Math.ceil(shown.length / columns) * rowHeight + line });
  const write = (text, x, y, colour = "--ink", size = 18) => {
    context.font = `${size}px ${getComputedStyle(document.body).fontFamily}`;
    context.fillStyle = styled(colour);
    context.fillText(text, x, y);
  };
  context.fillStyle = styled("--paper");
  context.fillRect(0, 0, canvas.width, canvas.height);
  answer.forEach((text, i) => write(text, gap, gap + (i + 0.6) * line, "--ink", 20));
  shown.forEach(([name, title], i) => {
    const { counts, saving } = result.methods[name], x = gap + (i % columns) * (cell + gap), y = top + Math.floor(i / columns) * rowHeight;
    write(`${title}${name === "ears" ? "" : `: ${formatSaving(saving)}`}`, x, y + line / 2);
    context.drawImage(panels[name].canvas, x, y + line, cell, cell);
    write(`${format(4 * counts.quads)} lanes, ${format(counts.helper_lanes)} helper lanes`, x, y + cell + 1.9 * line, "--soft", 16);
    write(`${format(counts.covering_triangles)} of ${format(counts.triangles)} triangles cover a pixel`, x, y + cell + 2.7 * line, "--soft", 16);
  });
  write("Exact counts by raster-harness; helper lanes in orange and red", gap, canvas.height - line / 2, "--soft", 16);
  return canvas;
}

/* The lines of a text in a font that are not wider than `width` px. */
function wrapText(context, text, width, font) {
  context.font = font;
  const lines = [""];
  for (const word of text.split(" ")) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (context.measureText(longer).width <= width) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}

function showAnswer(result) {
  const pieces = state.drawing ? [[DRAWING_HELP]] : describeResult(result, state.size);
  $("answer").replaceChildren(...pieces.map(([text, kind]) => (kind ? element("b", { class: kind }, text) : text)));
  // The height grows only: content below must not move while a vertex is dragged.
  $("answer").style.minHeight = `${$("answer").offsetHeight}px`;
  $("hint").hidden = Boolean(state.drawing);
  if (state.drawing) {
    $("vertex-count").textContent = `${state.drawing.length} placed so far`;
    return;
  }
  const lost = result.placed.lost > 0 ? `, ${result.placed.lost} of which coincide at this size` : "";
  const [width, height] = measureSize(result.placed.rings);
  $("vertex-count").textContent = `${format(countVertices(state.rings))} vertices${lost}, ${width} × ${height} px`;
  $("size-value").textContent = `${state.size} px`;
  $("rotation-value").textContent = `${state.rotation}°`;
  $("size").setAttribute("aria-valuetext", `${state.size} pixels`);
}

/* Convert grid coordinates (0 to GRID, y up) to the editor's SVG coordinates (0 to 1000, y down). */
const toEditor = ([x, y]) => [1000 * x / GRID, 1000 - 1000 * y / GRID];

function svgElement(name, attributes) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  return node;
}

function showEditor() {
  const rings = state.drawing ? [state.drawing] : state.rings;
  const outlines = state.drawing && state.cursor ? [[...state.drawing, state.cursor]] : rings;
  const path = outlines.map((ring) => (ring.length ? `M${ring.map((point) => toEditor(point).map((value) => value.toFixed(1)).join(" ")).join("L")}${state.drawing ? "" : "Z"}` : "")).join("");
  const nodes = [svgElement("path", { d: path, class: state.drawing ? "open" : "area" })];
  const vertices = listVertexIndices(rings), radius = vertices.length > 80 ? 7 : vertices.length > 30 ? 11 : 15;
  if (!state.drawing) {
    for (const [r, i] of vertices) {
      const [[x1, y1], [x2, y2]] = [rings[r][i], rings[r][(i + 1) % rings[r].length]].map(toEditor);
      nodes.push(svgElement("line", { x1, y1, x2, y2, class: "grip", "data-edge": `${r} ${i}` }));
    }
  }
  vertices.forEach(([r, i], number) => {
    const [cx, cy] = toEditor(rings[r][i]);
    nodes.push(svgElement("circle", { cx, cy, r: (isCoarse ? 3.6 : 2.2) * radius, class: "hold", "data-vertex": number }), svgElement("circle", { cx, cy, r: radius, class: `dot${number === state.selected ? " selected" : ""}` }));
  });
  if (state.drawing && state.cursor) {
    const [x, y] = toEditor(state.cursor);
    nodes.push(svgElement("path", { d: `M${x - 24} ${y}H${x + 24}M${x} ${y - 24}V${y + 24}`, class: "cross" }));
  }
  $("editor").replaceChildren(...nodes);
  $("editor").classList.toggle("drawing", Boolean(state.drawing));
  showControls();
}

function showControls() {
  const isDrawing = Boolean(state.drawing);
  $("draw").setAttribute("aria-pressed", String(isDrawing));
  $("draw").textContent = isDrawing ? "Close the polygon" : "Draw your own";
  $("remove").disabled = isDrawing ? !state.drawing.length : !canRemoveVertex();
  $("undo").disabled = !isDrawing && !state.history.length;
  $("copy").disabled = $("wkt").disabled = isDrawing;
  $("picture").disabled = isDrawing || !state.result?.methods.ears;
  $("typical").hidden = isDrawing || state.example !== EXAMPLES[0][0];
  for (const button of $("examples").querySelectorAll("[data-example]")) button.setAttribute("aria-pressed", String(!isDrawing && button.dataset.example === state.example));
  $("degrees-label").hidden = isDrawing || state.text === null || state.degrees === null;
  $("degrees").checked = Boolean(state.degrees);
  const isChoice = !isDrawing && state.text !== null && state.choices.length > 1;
  $("choices-label").hidden = !isChoice;
  if (isChoice) {
    $("choices").replaceChildren(...state.choices.map((label, i) => element("option", { value: i }, label)));
    $("choices").value = state.choice;
    $("previous").disabled = state.choice === 0;
    $("next").disabled = state.choice === state.choices.length - 1;
  }
  if (document.activeElement !== $("text")) $("text").value = state.text ?? "";
}

/* Show a message above the answer, or hide it if the text is empty. */
function showNotice(text) {
  $("copied").textContent = "";
  $("notice").textContent = text;
  $("notice").hidden = !text;
}

/* Dim the panels if they show an earlier polygon (isOutdated). */
function dimPanels(isOutdated) {
  $("methods").classList.toggle("stale", isOutdated);
}

function buildPanels() {
  for (const [name, title, description] of METHODS) {
    const panel = { saving: element("span"), best: element("span", { class: "best", hidden: "" }, "best"), canvas: element("canvas", { role: "img" }), missing: element("p", { class: "missing", hidden: "" }), caption: element("figcaption") };
    panels[name] = panel;
    $("methods").lastElementChild.before(element("figure", { "data-method": name }, element("h3", {}, element("span", {}, title, " ", panel.best), panel.saving), element("div", { class: "quiet" }, description), panel.canvas, panel.missing, panel.caption));
  }
}
