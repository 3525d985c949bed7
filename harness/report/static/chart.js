/* Predicted against measured: two panels, one mark per polygon or case. */

const chart = { plot: null, marks: [], at: -1 };

const metricUnit = (name) => state.report.figures[name]?.unit ?? "";

const chosen = (id) => $(id).value;
const isRatio = () => chosen("scale") === "ratio";

/* One mark per polygon and triangulator: {x: [left, right panel], y, case, polygon, index}. */
function marksOfPolygons() {
  const { cases, views } = state.report;
  const view = views[group().view];
  if (!view) return [];
  const base = casesOf(state.group).find((each) => each.row.triangulator === group().base);
  const criteria = [chosen("criterion-a"), chosen("criterion-b")];
  const measure = chosen("measure");
  if (isRatio() && !base?.counted) return [];
  const marks = [];
  for (const each of casesOf(state.group)) {
    const name = each.row.triangulator;
    if (!each.counted || !each.counted[measure] || (isRatio() && each === base)) continue;
    const predicted = view.predicted[name];
    const drawn = predicted.triangles;
    for (let k = 0; k < view.sampled.length; k++) {
      if (!drawn[k]) continue;
      const under = (column, name) => {
        if (!isRatio()) return 1;
        return view.predicted[name].triangles[k] ? column[k] : 0;
      };
      const x = criteria.map((c) => predicted[c][k] / under(view.predicted[group().base][c], group().base));
      const y = each.counted[measure][k] / under(base.counted[measure], group().base);
      marks.push({ x, y, case: each, polygon: k, index: cases.indexOf(each) });
    }
  }
  return marks;
}

function marksOfCases() {
  const { cases, groups } = state.report;
  const criteria = [chosen("criterion-a"), chosen("criterion-b")];
  const measure = chosen("measure");
  const bases = groups.map(() => null);
  for (const each of cases) {
    if (each.row.triangulator === groups[each.group].base) bases[each.group] = each;
  }
  const marks = [];
  cases.forEach((each, index) => {
    const base = bases[each.group];
    const comparable = base && base.row.polygons === each.row.polygons;
    if (each.row.status !== "ok" || (isRatio() && (!comparable || each === base))) return;
    const figure = (name) => each.row[name] / (isRatio() ? base.row[name] : 1);
    marks.push({ x: criteria.map((c) => figure(`predicted_${c}`)), y: figure(measure), case: each, polygon: null, index });
  });
  return marks;
}

/* Whether a triangulation equals the base's or has equal values on both axes, so that its mark is omitted. */
const isSame = (mark) => [mark.y, ...mark.x].every((value) => Math.abs(value - 1) < 1e-9);

const positive = (value) => Number.isFinite(value) && value > 0;

function drawChart() {
  const all = chosen("level") === "cases" ? marksOfCases() : marksOfPolygons();
  const possible = all.filter((m) => positive(m.y) && m.x.some(positive) && !isHidden(m.case.row.triangulator));
  const marks = isRatio() ? possible.filter((m) => !isSame(m)) : possible;
  chart.same = possible.length - marks.length;
  chart.marks = marks;
  chart.at = -1;
  const host = $("chart");
  host.hidden = !marks.length;
  $("chart-note").textContent = marks.length ? describeMarks(marks) : "No polygon or case matches these conditions: "
    + "the rasteriser has no counters, or the run has only one triangulator.";
  if (!marks.length) return;
  const stacked = host.clientWidth < 640;
  host.classList.toggle("stacked", stacked);
  if (chart.plot) chart.plot.resize();
  else chart.plot = echarts.init(host, null, { renderer: "canvas" });
  chart.plot.setOption(chartOption(marks, stacked), { notMerge: true });
  host.setAttribute("aria-label", `Predicted against measured ${words(chosen("measure"))}: ${marks.length} marks`);
}

function describeMarks(marks) {
  const view = state.report.views[group().view];
  const base = isRatio() ? `, relative to ${group().base} on the same ${chosen("level") === "cases" ? "scene" : "polygon"}` : "";
  const unit = [chosen("criterion-a"), chosen("criterion-b")].some(isInUnit);
  const line = isRatio() ? " On the dashed line both ratios are equal." : unit ? " On the dashed line both are equal." : "";
  const sample = chosen("level") === "polygons" && view && view.sampled.length < view.polygons
    ? ` A random sample of ${number(view.sampled.length)} of ${number(view.polygons)} polygons.` : "";
  const same = chart.same ? ` ${number(chart.same)} marks on 1, equal to ${group().base}, are not drawn.` : "";
  return `${number(marks.length)} marks${base}.${line}${same}${sample}`;
}

function axisTitle(name, unit) {
  return isRatio() ? `${name}, ratio to ${group().base}` : `${name}${unit ? ` [${unit}]` : ""}`;
}

function chartOption(marks, stacked) {
  const ink = styled("--ink"), soft = styled("--soft"), line = styled("--line");
  const criteria = [chosen("criterion-a"), chosen("criterion-b")];
  const panel = (i) => stacked
    ? { left: 62, right: 16, top: i ? "57%" : 48, height: "35%" }
    : { left: i ? "55%" : 62, right: i ? 16 : "52%", top: 48, bottom: 58 };
  const whole = $("chart").clientWidth, room = stacked ? whole - 12 : 0.45 * whole - 20;  // width of a title
  // All axes of ratios have the same range, so that the dashed lines of both panels are comparable.
  const every = isRatio() ? marks.flatMap((m) => [m.y, ...m.x]).filter(positive) : null;
  const axis = (name, i, y) => ({
    type: "log", logBase: spread(every ?? marks.map((m) => (y ? m.y : m.x[i]))) > 4 ? 2 : Math.SQRT2, gridIndex: i, name, nameLocation: "middle", nameGap: y ? 42 : 30,
    nameTextStyle: { color: ink, fontSize: stacked ? 11 : 12 }, axisLabel: { color: soft, formatter: (v) => String(+v.toPrecision(3)), hideOverlap: true,
      showMinLabel: false, showMaxLabel: false },
    axisLine: { show: true, lineStyle: { color: soft } }, splitLine: { lineStyle: { color: line } },
    min: every ? Math.min(1, sampleEnds(every)[0]) * 0.94 : (v) => v.min * 0.94,
    max: every ? Math.max(1, sampleEnds(every)[1]) * 1.06 : (v) => v.max * 1.06,
  });
  const measured = axisTitle(words(chosen("measure")), metricUnit(chosen("measure")));
  const series = [];
  for (const i of [0, 1]) {
    for (const name of namesOfAll()) {
      const data = marks
        .map((m, position) => [m.x[i], m.y, position, m.case.row.triangulator])
        .filter(([x, , , owner]) => owner === name && positive(x));
      series.push({ name, type: "scatter", xAxisIndex: i, yAxisIndex: i, data, symbol: shapeOf(name), symbolSize: 7,
        itemStyle: { color: colourOf(name), opacity: 0.55 }, emphasis: { scale: 2, itemStyle: { opacity: 1, borderColor: ink, borderWidth: 1.5 } } });
    }
    if (isRatio() || isInUnit(criteria[i])) series.push(diagonal(marks, i, soft));
  }
  return {
    animation: false,
    aria: { enabled: false },
    textStyle: { color: ink, fontFamily: "system-ui, sans-serif" },
    title: criteria.map((criterion, i) => ({ text: correlationText(criterion), textStyle: { fontSize: stacked ? 12 : 13, fontWeight: 600, color: ink, width: room, overflow: "break", lineHeight: 17 },
      left: stacked ? 4 : i ? "55%" : 62, top: stacked && i ? "51%" : 4 })),
    grid: [panel(0), panel(1)],
    xAxis: criteria.map((criterion, i) => axis(axisTitle(`predicted by ${words(criterion)}`, metricUnit(criterion)), i, false)),
    yAxis: [0, 1].map((i) => axis(i && !stacked ? "" : measured, i, true)),
    tooltip: { trigger: "item", confine: true, backgroundColor: styled("--panel"), borderColor: line, textStyle: { color: ink, fontSize: 13 },
      formatter: (point) => (point.data && point.data.length === 4 ? tooltip(chart.marks[point.data[2]]) : "") },
    series,
  };
}

/* Whether a prediction has the unit of the measurement, so that both are equal on the dashed line. */
const isInUnit = (criterion) => state.report.estimates[criterion] === chosen("measure");

function correlationText(criterion) {
  const fit = isInUnit(criterion) ? group().estimated[criterion] : null;
  const value = fit ? fit.rank : group().correlations[chosen("measure")]?.[criterion];
  const title = words(criterion);
  if (chosen("level") === "cases" || value === null || value === undefined) return title;
  const error = fit && fit.error !== null ? `, a polygon's ratio off by ${(100 * fit.error).toFixed(1)} %` : "";
  return `${title}: rank correlation ${value.toFixed(2)}${error}`;
}

function diagonal(marks, i, colour) {
  const values = marks.flatMap((m) => (isRatio() ? [1, m.y, ...m.x] : [m.y, m.x[i]])).filter(positive);
  const [low, high] = sampleEnds(values);
  return { type: "line", xAxisIndex: i, yAxisIndex: i, data: [[low, low], [high, high]], symbol: "none", silent: true,
    tooltip: { show: false }, lineStyle: { type: "dashed", width: 1.5, color: colour } };
}

/* Minimum and maximum; Math.min(...values) would exceed the limit of arguments of a call. */
function sampleEnds(values) {
  return values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
}

function spread(values) {
  const [low, high] = sampleEnds(values.filter(positive));
  return high / low;
}

function describeMark(mark) {
  const { row } = mark.case;
  const at = state.report.groups[mark.case.group];
  const [a, b] = [chosen("criterion-a"), chosen("criterion-b")];
  const of = isRatio() ? `, of ${at.base}'s` : "";
  const view = state.report.views[at.view];
  const which = mark.polygon === null ? `${at.scene}, all polygons` : `polygon ${view.sampled[mark.polygon]} of ${at.scene}`;
  const lines = [row.triangulator, which, `${at.rasteriser} on ${at.device}, ${at.condition}`];
  lines.push(`measured ${words(chosen("measure"))}: ${number(mark.y)}${of}`);
  for (const [i, criterion] of [a, b].entries()) {
    if (!i || a !== b) lines.push(`predicted by ${words(criterion)}: ${number(mark.x[i])}${of}`);
  }
  return lines;
}

function tooltip(mark) {
  const [name, ...lines] = describeMark(mark);
  return element("div", {}, element("strong", {}, name), ...lines.map((line) => element("div", {}, line)));
}

function openMark(mark) {
  if (mark.case.group !== state.group) choose(mark.case.group);
  const other = mark.case.row.triangulator;
  const view = state.report.views[group().view];
  openHeatmap(mark.polygon ?? (view ? sortByDifference(group().base, other)[0] : 0), group().base, other);
}

function stepThroughMarks(event) {
  const steps = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
  if (event.key === "Enter" && chart.at >= 0) return openMark(chart.ordered[chart.at]);
  if (!(event.key in steps) || !chart.marks.length) return;
  event.preventDefault();
  if (chart.at < 0) chart.ordered = [...chart.marks].sort((p, q) => p.x[0] - q.x[0]);
  const count = chart.ordered.length;
  chart.at = (chart.at + steps[event.key] + count) % count;
  const mark = chart.ordered[chart.at];
  $("mark").textContent = describeMark(mark).join("; ");
  const position = chart.marks.indexOf(mark);
  const series = chart.plot.getOption().series;
  const seriesIndex = series.findIndex((s) => s.type === "scatter" && s.name === mark.case.row.triangulator);
  const dataIndex = series[seriesIndex].data.findIndex((d) => d[2] === position);
  chart.plot.dispatchAction({ type: "showTip", seriesIndex, dataIndex });
}

function setUpChart() {
  for (const id of ["criterion-a", "criterion-b", "measure", "level", "scale"]) {
    $(id).addEventListener("change", () => { if (id === "level") fillMeasures(); drawChart(); });
  }
  $("chart").addEventListener("keydown", stepThroughMarks);
  let waiting = 0;
  new ResizeObserver(() => {
    if (!chart.plot || chart.plot.getWidth() === $("chart").clientWidth) return;
    clearTimeout(waiting);
    waiting = setTimeout(drawChart, 100);
  }).observe($("chart").parentElement);
  tables.chart = () => csvOfObjects(chart.marks.map((mark) => ({
    triangulator: mark.case.row.triangulator, rasteriser: mark.case.row.rasteriser, device: mark.case.row.device,
    resolution: mark.case.row.resolution, rotation: mark.case.row.rotation,
    polygon: mark.polygon === null ? "all" : state.report.views[group().view].sampled[mark.polygon],
    scale: chosen("scale"), base: group().base,
    [`predicted_${chosen("criterion-a")}`]: mark.x[0], [`predicted_${chosen("criterion-b")}`]: mark.x[1], [chosen("measure")]: mark.y,
  })));
}

/* Possible measures of marks: counters of polygons, or metrics of cases. */
function fillMeasures() {
  const before = chosen("measure");
  let names = group().measures;
  if (chosen("level") === "cases" || !names.length) {
    const { cases, measures } = state.report;
    names = ["draw_ms", ...measures].filter((name) => cases.some((each) => positive(each.row[name])));
  }
  options($("measure"), names.map((name) => [name, words(name)]), names.includes(before) ? before : group().main);
}

const PAPER = "overdraw";

/* The criterion with the highest rank correlation with the main counter, except the paper's. */
function bestOther() {
  const ranks = group().correlations[group().main] ?? {};
  const others = state.report.criteria.filter((name) => name !== PAPER);
  return others.reduce((best, name) => ((ranks[name] ?? -1) > (ranks[best] ?? -1) ? name : best), others[0]);
}

/* Names of the predictions, in the unit of a counter, that the selected polygons or cases have. */
function listEstimates() {
  const kept = Object.values(state.report.views[group().view]?.predicted ?? {})[0];
  return Object.keys(state.report.estimates).filter((name) => (kept ? name in kept : casesOf(state.group).some((each) => positive(each.row[`predicted_${name}`]))));
}

/* Update the choices and the chart when another group is selected. */
function fillChart() {
  const view = state.report.views[group().view];
  $("level").options[0].disabled = !view || !group().measures.length;
  if ($("level").options[0].disabled) $("level").value = "cases";
  const inUnit = listEstimates();
  const entries = [...inUnit, ...state.report.criteria].map((name) => [name, words(name)]);
  const defaults = [...inUnit.filter((name) => state.report.estimates[name] === group().main), PAPER, bestOther()];
  options($("criterion-a"), entries, chosen("criterion-a") || defaults[0]);
  options($("criterion-b"), entries, chosen("criterion-b") || defaults[1]);
  fillMeasures();
  drawChart();
  if (chart.plot && !chart.listening) {
    chart.listening = true;
    chart.plot.on("click", (point) => { if (point.data?.length === 4) openMark(chart.marks[point.data[2]]); });
  }
}
