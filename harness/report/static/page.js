"use strict";
/* What every part of the page uses: the numbers, what is chosen, elements and formats. */

const $ = (id) => document.getElementById(id);

/* Okabe and Ito's colours, told apart with any colour vision; black where the page is light. */
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D31"];
const COLOURS_IN_THE_DARK = ["#56B4E9", "#FF8A3D", "#2FC79A", "#E79AC5", "#F0C94A", "#9DA9FF", "#C9B28A"];
const SHAPES = ["circle", "rect", "triangle", "diamond", "pin", "arrow", "roundRect"];

const state = { report: null, group: 0, hidden: new Set(), dark: false };

async function unpack() {
  const text = atob($("data").textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
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

function options(select, entries, chosen) {
  select.replaceChildren(
    ...entries.map(([value, text]) => {
      const option = element("option", { value }, text);
      option.selected = value === chosen;
      return option;
    }),
  );
}

function number(value, digits = 4) {
  if (value === null || value === undefined) return "";
  if (Number.isInteger(value)) return value.toLocaleString("en-GB");
  if (Math.abs(value) >= 10 ** digits) return Math.round(value).toLocaleString("en-GB");
  return value.toPrecision(digits);
}

function words(name) {
  const { measures, criteria } = state.report;
  return measures[name] || criteria[name] || name.replaceAll("_", " ");
}

const group = () => state.report.groups[state.group];
const casesOf = (index) => state.report.cases.filter((each) => each.group === index);

/* A triangulator keeps its colour and shape wherever it is shown. */
const namesOfAll = () => state.report.triangulators;

function colourOf(name) {
  const colours = state.dark ? COLOURS_IN_THE_DARK : COLOURS;
  return colours[namesOfAll().indexOf(name) % colours.length];
}

/* The second seven have the first seven's colours, with other shapes. */
function shapeOf(name) {
  const place = namesOfAll().indexOf(name);
  return SHAPES[(place + Math.floor(place / SHAPES.length)) % SHAPES.length];
}

/* The colour a style variable has now, light or dark. */
function styled(variable) {
  const probe = element("i", { style: `color: var(${variable})` });
  document.body.append(probe);
  const colour = getComputedStyle(probe).color;
  probe.remove();
  return colour;
}

function isDark() {
  const theme = document.documentElement.dataset.theme;
  if (theme) return theme === "dark";
  return matchMedia("(prefers-color-scheme: dark)").matches;
}
