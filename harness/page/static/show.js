"use strict";
/* Display: numbers, the ranking of each view, predicted against measured. */

const conditionOf = (view) => `${view.resolution} px${view.rotation ? `, turned ${view.rotation}°` : ""}`;
const colourOf = (name) => state.page.looks[name][state.dark ? "dark" : "colour"];
const AGAIN = "(the base again)";
const MIN_RATIO_EPOCHS = 4;

/* Helper lanes of a case: 4 lanes per quad minus fragments. */
const helpersOf = (counters) => 4 * sum(counters.quads) - sum(counters.fragments);

/* Rows of a view's ranking: counters, and the time relative to the base if timed. */
function rankTriangulators(view) {
  const base = view.times?.[state.page.base];
  const rows = Object.entries(view.cases).map(([name, each]) => {
    const own = view.times?.[name];
    const enough = base && own && view.epochs.length >= MIN_RATIO_EPOCHS;
    return { name, ...each, time: own, complete: each.record.polygons === Math.max(...Object.values(view.cases).map((c) => c.record.polygons)),
      ratio: enough && name !== state.page.base ? pairedRatio(own.samples_s, base.samples_s, view.epochs) : null };
  });
  const cost = (row) => (row.name === state.page.base ? 1 : row.ratio?.value ?? Infinity);
  return rows.sort((p, q) => q.complete - p.complete || cost(p) - cost(q) || helpersOf(p.counters) - helpersOf(q.counters));
}

const verdictOf = (ratio) => (ratio.high < 1 ? "faster" : ratio.low > 1 ? "slower" : "not significant");

function rankingOf(view) {
  const hasRatio = (row) => row.ratio && row.complete;
  const rows = rankTriangulators(view).map((row) => ({ ...row, colour: colourOf(row.name), isBase: row.name === state.page.base,
    verdict: hasRatio(row) ? verdictOf(row.ratio) : "" }));
  const columns = [
    ["triangulator", "name", (row) => `\u2060${row.name}`],
    [`time against ${state.page.base} (95 %)`, "number", (row) => (row.isBase ? "1" : hasRatio(row)
      ? `${row.ratio.value.toFixed(3)} (${row.ratio.low.toFixed(3)}–${row.ratio.high.toFixed(3)})` : "")],
    ["verdict", "verdict", (row) => (row.isBase ? "the base" : row.complete ? row.verdict : `${count(row.record.polygons)} polygons`)],
    ["draw [ms]", "number", (row) => (row.time?.samples_s.length ? digits(median(row.time.samples_s) * 1e3) : "")],
    ["helper lanes", "number", (row) => count(helpersOf(row.counters))],
    ["covering triangles", "number", (row) => count(sum(row.counters.covering_triangles))],
    ["counters", null, (row) => (row.differing ? `differ in ${count(row.differing)} polygons` : "as expected")],
  ];
  const again = view.times?.[AGAIN], base = view.times?.[state.page.base];
  const note = again && view.epochs.length >= MIN_RATIO_EPOCHS ? pairedRatio(again.samples_s, base.samples_s, view.epochs) : null;
  return element("div", {}, rankingTable(`Ranking at ${conditionOf(view)}`, conditionOf(view), columns, rows),
    note ? element("p", { class: "quiet" }, `${state.page.base} drawn a second time, under another name: ${note.value.toFixed(3)} `
      + `(${note.low.toFixed(3)}–${note.high.toFixed(3)}). An interval that excludes 1 here shows the error of times on this device.`) : null);
}

/* Marks of one criterion: predicted and measured, relative to the base. */
function listMarks(view, criterion) {
  const rows = rankTriangulators(view).filter((row) => row.ratio && row.complete);
  const base = view.cases[state.page.base]?.record.predicted[criterion];
  return rows.map((row) => ({ name: row.name, x: row.record.predicted[criterion] / base, y: row.ratio.value }));
}

function drawCharts() {
  const view = state.result?.views.find((each) => each.times && listMarks(each, "overdraw").length > 1);
  $("chart-section").hidden = !view;
  if (!view) return;
  const host = $("chart");
  const stacked = host.clientWidth < 640;
  const names = Object.keys(state.page.criteria);
  host.style.height = stacked ? `${names.length * 19}rem` : "24rem";
  state.plot ??= echarts.init(host, null, { renderer: "canvas" });
  state.plot.resize();
  const ink = styled("--ink"), soft = styled("--soft"), line = styled("--line");
  const panels = names.map((name, k) => (stacked
    ? { left: 54, right: 14, top: `${3 + (k * 88) / names.length}%`, height: `${60 / names.length}%` }
    : { left: `${6 + (k * 94) / names.length}%`, width: `${78 / names.length}%`, top: 40, bottom: 84 }));
  const all = names.map((name) => listMarks(view, name));
  const axis = (title, k, y) => ({ type: "value", scale: true, gridIndex: k, name: title, nameLocation: "middle", nameGap: y ? 40 : 26,
    nameTextStyle: { color: ink, fontSize: 12 }, axisLabel: { color: soft, hideOverlap: true, formatter: (value) => String(+value.toPrecision(3)) },
    axisLine: { show: true, lineStyle: { color: soft } }, splitLine: { lineStyle: { color: line } } });
  state.plot.setOption({
    animation: false, textStyle: { color: ink, fontFamily: "system-ui, sans-serif" }, grid: panels,
    title: names.map((name, k) => {
      const rank = rankCorrelation(all[k].map((mark) => mark.x), all[k].map((mark) => mark.y));
      return { text: rank === null ? "" : `rank correlation ${rank.toFixed(2)}`, left: panels[k].left, textStyle: { fontSize: 12, color: ink },
        top: stacked ? `${(k * 88) / names.length}%` : 12 };
    }),
    xAxis: names.map((name, k) => axis(`predicted by ${state.page.criteria[name]}`, k, false)),
    yAxis: names.map((name, k) => axis(k && !stacked ? "" : "measured time", k, true)),
    tooltip: { confine: true, backgroundColor: styled("--panel"), textStyle: { color: ink },
      formatter: ({ data: [x, y, name] }) => element("div", {}, `${name}: predicted ${x.toFixed(3)}, measured ${y.toFixed(3)}`) },
    legend: { bottom: 0, itemWidth: 12, itemHeight: 12, textStyle: { color: ink, fontSize: 12 }, inactiveColor: soft,
      data: all[0].map((mark) => ({ name: mark.name, icon: state.page.looks[mark.name].symbol })) },
    series: names.flatMap((_, k) => all[k].map((mark) => ({ type: "scatter", name: mark.name, xAxisIndex: k, yAxisIndex: k, symbolSize: 11,
      symbol: state.page.looks[mark.name].symbol, itemStyle: { color: colourOf(mark.name) }, data: [[mark.x, mark.y, mark.name]] }))),
  }, { notMerge: true });
  $("chart-note").textContent = `${conditionOf(view)}; both relative to ${state.page.base}. One mark is a triangulator.`;
}

/* The sentence with the result. */
function describeAnswer(result) {
  const name = deviceName(result, "this device");
  const view = result.views.find((each) => each.times && rankTriangulators(each).some((row) => row.ratio && row.complete));
  const differing = sum(result.views.flatMap((each) => Object.values(each.cases)).map((each) => each.differing));
  const counted = differing ? `Counters differ from the expected ones in ${count(differing)} polygons.` : "All counters are the expected ones.";
  if (!view) return `On ${name}: ${counted}`;
  const best = rankTriangulators(view).find((row) => row.complete);
  if (best.name === state.page.base) return `On ${name}, nothing is faster than ${best.name} at ${conditionOf(view)}. ${counted}`;
  const { value, low, high } = best.ratio;
  return `On ${name}, the same polygons at ${conditionOf(view)} take ${value.toFixed(2)} (${low.toFixed(2)} to ${high.toFixed(2)}) of the time `
    + `when triangulated by ${best.name} rather than by ${state.page.base}. ${counted}`;
}

function show() {
  const { result } = state;
  state.dark = matchMedia("(prefers-color-scheme: dark)").matches;
  if (!result) return;
  showDevice(result);
  $("ranking").replaceChildren(...result.views.filter((view) => Object.keys(view.cases).length).map(rankingOf));
  drawCharts();
}
