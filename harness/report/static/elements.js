"use strict";
/* Functions of the report and of measuring pages: embedded data, elements, colours of the style. */

const $ = (id) => document.getElementById(id);

/* Base64 of an array's bytes: decode(text, Int32Array). */
function decode(text, Kind) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let k = 0; k < binary.length; k++) bytes[k] = binary.charCodeAt(k);
  return new Kind(bytes.buffer);
}

/* The data embedded in the page. */
async function unpack() {
  const packed = decode($("data").textContent.trim(), Uint8Array);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return JSON.parse(await new Response(stream).text());
}

/* element("td", {class: "number"}, child, ...); children are nodes or text, never markup. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) made.setAttribute(key, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

/* The current colour of a style variable, which depends on the light or dark theme. */
function styled(variable) {
  const probe = element("i", { style: `color: var(${variable})` });
  document.body.append(probe);
  const colour = getComputedStyle(probe).color;
  probe.remove();
  return colour;
}

/* A ranking as a table that scrolls sideways. rows: {name, colour, complete, verdict, ...}; columns: [heading, class, row -> text
   or node, meaning], of which the class "name" is the row's own heading. */
function rankingTable(label, caption, columns, rows) {
  const head = columns.map(([text, kind, , title]) => element("th", { scope: "col", class: kind === "name" ? null : kind, title }, text));
  const body = rows.map((row) => element("tr", { class: row.complete ? null : "incomplete" }, ...columns.map(([heading, kind, show]) => (kind === "name"
    ? element("th", { scope: "row" }, element("span", { class: "key", style: `background:${row.colour}`, "aria-hidden": "true" }), show(row))
    : element("td", { class: kind === "verdict" ? `verdict ${row.verdict}` : kind, "data-label": heading }, show(row))))));
  return element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": label }, element("table", { class: "ranking" },
    element("caption", {}, caption), element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...body)));
}
