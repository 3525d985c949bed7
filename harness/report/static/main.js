/* Start of the page, and updates when the selection changes. */

const MAX_OPEN_BOXES = 12;

/* Select a group (scene, conditions, rasteriser, device), and update all sections of the page. */
function choose(index) {
  state.group = index;
  const { groups } = state.report;
  const conditions = [...new Set(groups.map((each) => `${each.scene}, ${each.condition}`))];
  options($("condition"), conditions.map((text) => [text, text]), `${group().scene}, ${group().condition}`);
  options($("target"), listSimilarGroups().map(([each, i]) => [String(i), `${each.rasteriser} on ${each.device}`]), String(index));
  $("answer").textContent = state.report.study || group().answer;
  $("judged").textContent = group().judged;
  fillChart();
  drawRanking();
  fillHeatmap();
}

function chooseCondition() {
  const { rasteriser, device } = group();
  const alike = state.report.groups.map((each, i) => [each, i]).filter(([each]) => `${each.scene}, ${each.condition}` === $("condition").value);
  const same = alike.find(([each]) => each.rasteriser === rasteriser && each.device === device) ?? alike[0];
  choose(same[1]);
  $("status").textContent = `Showing ${$("condition").value}`;
}

/* A checkbox per family of triangulators; collapsed for the many families of a study. */
function addNameBoxes() {
  const families = [...new Set(namesOfAll().map(familyOf))];
  const boxes = families.map((family) => {
    const name = namesOfAll().find((each) => familyOf(each) === family);
    const box = element("input", { type: "checkbox", value: family, checked: "" });
    box.addEventListener("change", () => {
      if (box.checked) state.hidden.delete(family); else state.hidden.add(family);
      drawChart();
      drawRanking();
      $("status").textContent = `${family} ${box.checked ? "shown" : "hidden"}`;
    });
    return element("label", {}, box, element("span", { class: "key", "data-name": name, "aria-hidden": "true" }), family);
  });
  if (boxes.length <= MAX_OPEN_BOXES) $("names").append(...boxes);
  else $("names").append(element("details", {}, element("summary", {}, `all ${boxes.length} shown; choose`), ...boxes));
}

function redraw() {
  state.dark = isDark();
  redrawKeys();
  if (!state.report.groups.length) return;
  drawChart();
  drawRanking();
  if (currentDrawing()) { drawGallery(); drawHeatmap(); }
}

function setTheme(theme) {
  if (theme) document.documentElement.dataset.theme = theme; else delete document.documentElement.dataset.theme;
  $("theme").textContent = `Colours: ${theme || "as the system"}`;
}

function setUpTheme() {
  const themes = ["", "light", "dark"];
  let at = 0;
  $("theme").addEventListener("click", () => { at = (at + 1) % themes.length; setTheme(themes[at]); redraw(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  // Charts are redrawn in light colours for printing, and restored afterwards.
  addEventListener("beforeprint", () => { for (const each of document.querySelectorAll("details")) each.open = true; setTheme("light"); redraw(); });
  addEventListener("afterprint", () => { setTheme(themes[at]); redraw(); });
}

async function start() {
  state.report = await unpack();
  state.dark = isDark();
  addCsvButtons();
  addNameBoxes();
  setUpTheme();
  setUpChart();
  setUpHeatmap();
  setUpMatrix();
  setUpCases();
  const { environment, groups } = state.report;
  tables.environment = () => csv(["section", "fact", "value"], environment);
  $("filters").addEventListener("submit", (event) => event.preventDefault());
  $("condition").addEventListener("change", chooseCondition);
  $("target").addEventListener("change", () => { choose(+$("target").value); $("status").textContent = `Showing ${$("target").selectedOptions[0].text}`; });
  if (state.report.study) $("level").value = "cases";
  if (groups.length) choose(0);
  else for (const id of ["filters", "chart-controls", "chart", "chart-keys", "heatmap-section"]) $(id).hidden = true;
  redrawKeys();
  document.documentElement.dataset.ready = String(Math.round(performance.now()));
}

function redrawKeys() {
  for (const key of document.querySelectorAll("[data-name]")) key.style.background = colourOf(key.dataset.name);
}

start();
