/* The table of criteria (rows) and measurements (columns), shaded by the absolute value of the statistic in a cell. */

function cellStyle(matrix, value) {
  if (value === null) return null;
  const strength = Math.round(Math.min(1, Math.abs(value)) ** 2 * 55);
  return `background: color-mix(in srgb, var(${value < 0 ? "--bad" : "--accent"}) ${strength}%, var(--paper))`;
}

function drawMatrix() {
  const { matrices } = state.report;
  const matrix = matrices.find((each) => each.statistic === $("statistic").value);
  if (!matrix) {
    $("matrix").replaceChildren(element("p", { class: "empty" }, "No criterion can be evaluated, as the run has no counters per polygon."));
    return;
  }
  const best = matrix.columns.map((_, j) => Math.max(...matrix.cells.map((row) => row[j]?.[0] ?? -Infinity)));
  const head = element("tr", {}, element("th", { scope: "col" }, "criterion"), ...matrix.columns.map((column) =>
    element("th", { scope: "col" }, column.title, element("small", {}, `${column.rasteriser} on ${column.device}`))));
  const body = matrix.rows.map((row, i) => element("tr", {}, element("th", { scope: "row", title: meaning(row.name.replaceAll("-", "_")) }, row.title), ...matrix.columns.map((_, j) => {
    const [value, low, high] = matrix.cells[i][j] ?? [null, null, null];
    if (value === null) return element("td", { title: "the same for every triangulation, or not measured" }, "–");
    const is = value === best[j];
    const interval = low !== null && high !== null ? element("small", {}, `${low.toFixed(3)} to ${high.toFixed(3)}`) : null;
    return element("td", { style: cellStyle(matrix, value), class: is ? "best" : null }, value.toFixed(3), is ? element("span", { class: "unseen" }, " best") : null, interval);
  })));
  $("matrix").replaceChildren(element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Matrix of criteria and measurements" },
    element("table", { class: "matrix" }, element("caption", {}, matrix.title), element("thead", {}, head), element("tbody", {}, ...body))));
}

function setUpMatrix() {
  const { matrices, study, groups } = state.report;
  options($("statistic"), matrices.map((each) => [each.statistic, each.title]));
  $("statistic").addEventListener("change", drawMatrix);
  $("matrix-note").textContent = study
    ? "Small numbers are 95 % intervals. The best criterion of a column is framed."
    : `Of all polygons and triangulators in ${groups[0]?.condition ?? ""}, relative to ${groups[0]?.base ?? ""} on the same polygon. `
      + "The best value of a column is framed. raster-harness study validate evaluates criteria on many triangulations per polygon, with intervals.";
  tables.matrix = () => csv(["rasteriser", "device", "criterion", "measure", "statistic", "value", "ci_low", "ci_high"],
    matrices.flatMap((m) => m.rows.flatMap((row, i) => m.columns.flatMap((c, j) => (m.cells[i][j] ? [[c.rasteriser, c.device, row.name, c.measure, m.statistic, ...m.cells[i][j]]] : [])))));
  drawMatrix();
}
