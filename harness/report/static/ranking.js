/* The ranking of triangulators: a table for each rasteriser and device of the selected conditions. */

const WIDTH = 210;

function listSimilarGroups() {
  const { groups } = state.report;
  const { scene, condition } = group();
  return groups.map((each, index) => [each, index]).filter(([g]) => g.scene === scene && g.condition === condition);
}

/* The visible ranked cases of a group, in the order of the terminal's table. */
function ranked(index) {
  const good = casesOf(index).filter((each) => each.rank !== null).sort((p, q) => p.rank - q.rank);
  const shown = good.filter((each) => !isHidden(each.row.triangulator));
  return shown.map((each) => ({ ...each, most: good[0].row.polygons }));
}

/* Time relative to the base with the interval, or without times the main counter relative to the base. */
function comparison(each, at, base) {
  const { row } = each;
  if (!each.complete) return null;
  if (row.time_ratio) return { value: row.time_ratio, low: row.time_ratio_low, high: row.time_ratio_high };
  if (row.draw_ms || !base || !row[at.main] || !base.row[at.main]) return null;
  const value = row[at.main] / base.row[at.main];
  return { value, low: value, high: value };
}

function intervalPicture(ratio, low, high, colour) {
  const x = (value) => 6 + ((value - low) / (high - low)) * (WIDTH - 12);
  const space = "http://www.w3.org/2000/svg";
  const part = (name, attributes) => {
    const made = document.createElementNS(space, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    return made;
  };
  const text = `${ratio.value.toFixed(3)}, 95 % interval ${ratio.low.toFixed(3)} to ${ratio.high.toFixed(3)}`;
  const picture = part("svg", { viewBox: `0 0 ${WIDTH} 18`, role: "img", "aria-label": text });
  picture.append(
    part("line", { x1: x(1), x2: x(1), y1: 0, y2: 18, stroke: "var(--soft)", "stroke-dasharray": "3 2" }),
    part("rect", { x: Math.min(x(1), x(ratio.value)), width: Math.abs(x(ratio.value) - x(1)), y: 5, height: 8, fill: colour, opacity: 0.3 }),
    part("line", { x1: x(ratio.low), x2: x(ratio.high), y1: 9, y2: 9, stroke: colour, "stroke-width": 2.5 }),
    part("circle", { cx: x(ratio.value), cy: 9, r: 4, fill: colour }),
  );
  return picture;
}

/* Columns [heading, meaning, row -> text]: draw time, main counter, regret (or overshading), time to triangulate. The table of
   cases has all other metrics. */
function rankingColumns(at, rows) {
  const { figures } = state.report;
  const interval = (row) => (row.draw_ms ? `${number(row.draw_ms)} (${number(row.draw_low_ms, 3)}–${number(row.draw_high_ms, 3)})` : "");
  const plain = (name) => {
    const { unit, kind } = figures[name];
    return [kind === "time" ? `${words(name)} [${unit}]` : words(name), meaning(name), (row) => figureText(name, row[name], kind === "time" ? 3 : 4)];
  };
  const others = [at.main, "regret" in figures ? "regret" : "overshading", "triangulate_ms"].filter((name) => name && name in figures);
  const columns = [["draw [ms], median (95\u00a0%)", meaning("draw_ms"), interval], ...others.map(plain)];
  return columns.filter(([, , show]) => rows.some((each) => show(each.row)));
}

function rankingOf(at, index) {
  const rows = ranked(index);
  if (!rows.length) return null;
  const base = rows.find((each) => each.row.triangulator === at.base);
  const timed = rows.some((each) => each.row.time_ratio);
  rows.forEach((each) => Object.assign(each, { colour: colourOf(each.row.triangulator), ratio: comparison(each, at, base),
    verdict: each === base ? "" : each.row.verdict ?? "" }));
  const known = rows.map((each) => each.ratio).filter(Boolean);
  const low = Math.min(1, ...known.map((r) => r.low)) - 0.01, high = Math.max(1, ...known.map((r) => r.high)) + 0.01;
  const between = ({ ratio }) => (timed ? ` (${ratio.low.toFixed(3)}–${ratio.high.toFixed(3)})` : "");
  const columns = [
    ["", "number", (each) => (each.complete ? String(each.rank) : "–")],
    ["triangulator", "name", (each) => each.row.triangulator],
    ["ratio (95\u00a0%)", "number", (each) => (!each.ratio ? "" : each === base ? "1" : `${each.ratio.value.toFixed(3)}${between(each)}`)],
    ["verdict", "verdict", (each) => (each === base ? "the base" : each.complete ? each.verdict : `${number(each.row.polygons)} of ${number(each.most)} polygons`)],
    [`${timed ? "time" : words(at.main || "")} against ${at.base}`, "picture",
      (each) => (each.ratio && known.length > 1 ? intervalPicture(each.ratio, low, high, each.colour) : null)],
    ...(rows.some((each) => each.row.break_even) ? [["break-even", "pays", (each) => (each.complete ? each.row.break_even ?? "" : ""), meaning("break_even")]] : []),
    ...rankingColumns(at, rows).map(([title, what, show]) => [title, "number", (each) => show(each.row), what]),
  ];
  return element("div", {}, rankingTable(`Ranking: ${at.rasteriser} on ${at.device}`, `${at.rasteriser} on ${at.device}, ${at.condition}`, columns, rows),
    ...at.views.map((line) => element("p", { class: "quiet" }, line)));
}

function drawRanking() {
  const made = listSimilarGroups().map(([at, index]) => rankingOf(at, index)).filter(Boolean);
  $("ranking").replaceChildren(...(made.length ? made : [element("p", { class: "empty" }, "No triangulator was measured for this selection.")]));
  tables.ranking = () => csvOfObjects(listSimilarGroups().flatMap(([, index]) => ranked(index).map((each) => ({ rank: each.complete ? each.rank : "", ...each.row }))));
}
