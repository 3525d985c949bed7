/* The table of all cases: searchable, sortable, PAGE rows at a time. */

const PAGE = 50;
const list = { from: 0, sort: null, descending: false };

/* [heading, name of the metric]; columns without values are removed when the page starts. */
let fields = [];

function listFields() {
  const { figures } = state.report;
  const shown = Object.keys(figures).filter((name) => figures[name].kind !== "prediction" && figures[name].better !== "none");
  const withUnit = (name) => (figures[name].kind === "time" && figures[name].unit !== "x" ? `${words(name)} [${figures[name].unit}]` : words(name));
  return [["triangulator", "triangulator"], ["rasteriser", "rasteriser"], ["device", "device"], ["conditions", null], ["status", "status"],
    ["time ratio", "time_ratio"], ["verdict", "verdict"], ["break-even", "break_even"], ...shown.map((name) => [withUnit(name), name]), ["notes", "reason"]];
}

function fieldOf(each, name) {
  if (name === null) return state.report.groups[each.group].condition;
  if (name === "reason") return [each.row.reason, ...each.warnings].filter(Boolean).join("; ");
  if (name === "verdict" && each.row.triangulator === state.report.groups[each.group].base) return "the base";
  return each.row[name];
}

function filterCases() {
  const wanted = $("find").value.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const status = $("state").value;
  const found = state.report.cases.filter((each) => {
    if (status && each.row.status !== status) return false;
    if (!wanted.length) return true;
    const text = `${each.row.triangulator} ${each.row.rasteriser} ${each.row.device} ${fieldOf(each, null)} ${fieldOf(each, "reason")}`.toLowerCase();
    return wanted.every((word) => text.includes(word));
  });
  if (list.sort === null) return found;
  const name = fields[list.sort][1], sign = list.descending ? -1 : 1;
  const order = new Intl.Collator("en", { numeric: true });
  const compare = (p, q) => (typeof p === "number" && typeof q === "number" ? p - q : order.compare(p, q));
  return found.sort((p, q) => {
    const [a, b] = [fieldOf(p, name), fieldOf(q, name)];
    const lacks = (v) => v === null || v === undefined || v === "";
    return lacks(a) || lacks(b) ? lacks(a) - lacks(b) : sign * compare(a, b);
  });
}

function drawCases() {
  const found = filterCases();
  list.from = Math.max(0, Math.min(list.from, Math.floor((found.length - 1) / PAGE) * PAGE));
  const rows = found.slice(list.from, list.from + PAGE);
  const head = element("tr", {}, ...fields.map(([title, name], column) => {
    const button = element("button", { type: "button", title: name && meaning(name) }, title);
    button.addEventListener("click", () => {
      list.descending = list.sort === column ? !list.descending : false;
      list.sort = column;
      drawCases();
      $("cases").querySelectorAll("thead button")[column].focus();
    });
    const sorted = list.sort === column ? (list.descending ? "descending" : "ascending") : null;
    return element("th", { scope: "col", "aria-sort": sorted }, button);
  }));
  const body = rows.map((each) => element("tr", {}, ...fields.map(([, name], column) => {
    const value = fieldOf(each, name);
    const isNumber = typeof value === "number";
    const attributes = { class: isNumber ? "number" : name === "reason" ? "reason" : name === "verdict" ? `verdict ${value ?? ""}` : null, scope: column ? null : "row" };
    return element(column ? "td" : "th", attributes, isNumber ? figureText(name, value) : value ?? "");
  })));
  $("cases").replaceChildren(element("caption", { class: "unseen" }, "Cases, one a row"), element("thead", {}, head), element("tbody", {}, ...body));
  $("found").textContent = found.length ? `${number(list.from + 1)} to ${number(list.from + rows.length)} of ${number(found.length)}` : "no matching case";
  $("before").disabled = list.from === 0;
  $("after").disabled = list.from + PAGE >= found.length;
  $("pages").hidden = found.length <= PAGE;
}

function setUpCases() {
  fields = listFields().filter(([, name]) => state.report.cases.some((each) => ![null, undefined, ""].includes(fieldOf(each, name))));
  const again = () => { list.from = 0; drawCases(); };
  $("find").addEventListener("input", again);
  $("state").addEventListener("change", again);
  $("before").addEventListener("click", () => { list.from -= PAGE; drawCases(); });
  $("after").addEventListener("click", () => { list.from += PAGE; drawCases(); });
  $("show-failed")?.addEventListener("click", () => { $("state").value = "failed"; again(); });
  tables.cases = () => csvOfObjects(filterCases().map((each) => each.row));
  drawCases();
}
