"use strict";
/* What every part of the page uses: the numbers, what is chosen, elements and formats. */

const $ = (id) => document.getElementById(id);

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

/* A figure's title: half-perimeter H, helper lanes. */
function words(name) {
  return state.report.figures[name]?.title ?? name.replaceAll("_", " ");
}

/* What a figure is, for a tooltip. */
function meaning(name) {
  return state.report.figures[name]?.description || null;
}

const group = () => state.report.groups[state.group];
const casesOf = (index) => state.report.cases.filter((each) => each.group === index);

/* A triangulator keeps its colour and shape wherever it is shown. */
const namesOfAll = () => state.report.triangulators;

function colourOf(name) {
  const look = state.report.looks[name];
  return state.dark ? look.dark : look.colour;
}

const shapeOf = (name) => state.report.looks[name].symbol;

/* random#1 and random#2 are one family: one colour, one box to tick. */
const familyOf = (name) => name.split("#")[0];
const isHidden = (name) => state.hidden.has(familyOf(name));

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
