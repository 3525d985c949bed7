"use strict";
/* State of the report, and the names, formats and colours that its scripts share. */

const state = { report: null, group: 0, hidden: new Set(), dark: false };

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

/* The title of a metric: half-perimeter H, helper lanes. */
function words(name) {
  return state.report.figures[name]?.title ?? name.replaceAll("_", " ");
}

/* The value of a metric; a share as a percentage. */
function figureText(name, value, digits = 4) {
  if (!state.report.figures[name]?.percent || typeof value !== "number") return number(value, digits);
  return `${(100 * value).toFixed(1)}\u00a0%`;
}

/* The description of a metric, for a tooltip. */
function meaning(name) {
  return state.report.figures[name]?.description || null;
}

const group = () => state.report.groups[state.group];
const casesOf = (index) => state.report.cases.filter((each) => each.group === index);

/* A triangulator has the same colour and shape everywhere. */
const namesOfAll = () => state.report.triangulators;

function colourOf(name) {
  const look = state.report.looks[name];
  return state.dark ? look.dark : look.colour;
}

const shapeOf = (name) => state.report.looks[name].symbol;

/* random#1 and random#2 are one family, with one colour and one checkbox. */
const familyOf = (name) => name.split("#")[0];
const isHidden = (name) => state.hidden.has(familyOf(name));

function isDark() {
  const theme = document.documentElement.dataset.theme;
  if (theme) return theme === "dark";
  return matchMedia("(prefers-color-scheme: dark)").matches;
}
