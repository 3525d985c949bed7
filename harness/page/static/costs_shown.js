"use strict";
/* Display of a profile: sentences as in harness/profile/report.py, charts and tables. */

const UNITS = [[1, "s"], [1e-3, "ms"], [1e-6, "µs"], [1e-9, "ns"], [1e-12, "ps"]];
const ZERO_S = 1e-16;

/* Terms for the first sentence, in order of importance: it states the first MAX_STATED_COSTS significant costs. */
const STATED_COSTS = { triangles: "a triangle", set_up: "a triangle with a pixel centre in its box", covering: "a triangle that covers a pixel", tile_pairs: "a 16x16 tile of a covering triangle", transformed_vertices: "a transformed vertex", vertex_batches: "a vertex batch", fragments: "a covered pixel",
  helper_lanes: "a helper lane", blocks: "a 4x4 block", further_tiles: "a further 64x64 tile", near: "a pixel of its box's first width and height",
  half_perimeter: "a pixel of its box's width and height", rows: "a row of pixels", bbox_tests: "a pixel of its box", work: "a round of arithmetic", draw: "a draw" };
const MAX_STATED_COSTS = 4;

function formatSeconds(value) {
  const short = (number) => (number >= 10 ? number.toFixed(0) : String(+number.toPrecision(2)));
  const [step, unit] = UNITS.find(([least]) => value >= least) ?? (value < ZERO_S ? [1, "s"] : UNITS.at(-1));
  return value < ZERO_S ? "0 s" : `${short(value / step)} ${unit}`;
}

const formatPercent = (value, places = 0) => `${(100 * value).toFixed(places)}\u00a0%`;
const joinWords = (words) => (words.length < 2 ? words.join("") : `${words.slice(0, -1).join(", ")} and ${words.at(-1)}`);
const listTerms = ({ law }) => Object.entries(state.page.terms).map(([name, term], j) =>
  ({ name, ...term, seconds: law.seconds[j], low: law.low[j], high: law.high[j], shown: law.shown[j], known: law.known[j] }));

/* [name, terms, number of draws in which the stage is the slowest] of each stage. */
const listStages = ({ law }) => Object.entries(state.page.forms[law.form]).map(([name, terms], stage) =>
  [name, terms, law.binding.filter((own) => own === stage).length]);

function describeLaw(profile) {
  const terms = new Map(listTerms(profile).map((term) => [term.name, term])), stages = listStages(profile), several = stages.length > 1;
  const costs = (names) => names.map((name) => terms.get(name)).filter((term) => term.shown)
    .map((term) => term.sentence.replace("{}", formatSeconds(term.seconds)));
  const counted = ["draw", ...stages.flatMap(([, names]) => names)].map((name) => terms.get(name)).filter((term) => !term.shown);
  const rest = (known, text) => {
    const nouns = counted.filter((term) => term.known === known).map((term) => term.noun);
    return nouns.length ? [`${text}: ${joinWords(nouns)}.`] : [];
  };
  return [...costs(["draw"]), ...(several ? [`A draw takes the time of the slowest of ${stages.length} stages: ${joinWords(stages.map(([name]) => name))}.`] : []),
    ...stages.flatMap(([name, names, draws]) => [...(several ? [`Stage ${name}, the slowest in ${count(draws)} draws:`] : []), ...costs(names)]),
    ...rest(true, "No significant cost"), ...rest(false, "Unknown, as no draws separate")];
}

function describeThin({ area, aspects, ratios, low, high, doubled_at }) {
  const short = (value) => String(+value.toPrecision(2));
  const text = `Thin triangles of ${area} px² take ${short(ratios.at(-1))} times as long at ${aspects.at(-1)}:1 as at 1:1 `
    + `(${low.at(-1).toFixed(2)} to ${high.at(-1).toFixed(2)})`;
  if (!doubled_at) return `${text}.`;
  const [at, from, to] = doubled_at.map((value) => value.toFixed(0));
  return `${text}; twice as long from ${at}:1 on (${from} to ${to}).`;
}

function describeAdvice({ advice }) {
  if (!advice) return [];
  const { page } = state;
  const saved = advice.saved.map(({ scene, value, low, high }) => `${formatPercent(value, 1)} on ${scene} (${formatPercent(low, 1)} to ${formatPercent(high, 1)})`);
  return [`Triangulate by ${advice.triangulator}: by the model, it saves ${joinWords(saved)} of ear clipping's time, without the constant cost of a draw.`,
    `Extra time compared with the best criterion for each scene: ${joinWords(Object.entries(page.criteria).map(([name, short]) => `${short} ${formatPercent(advice.regret[name], 1)}`))}. `
      + "raster-harness import reports whether optimal:calibrated, with this device's costs, saves more."];
}

/* Sentences that limit what the times say: timer, counters, device. */
function describeCaveats(result, profile) {
  const { timer, device } = result;
  const words = [];
  if (timer) {
    const step = formatSeconds(timer.resolution_s);
    words.push(timer.timer === "gpu" ? `The GPU timer's resolution is ${step}; each time is of a batch of draws that takes at least 100 times as long.`
      : `Times are wall-clock times (${timer.reason}). The resolution is ${step}, and a request to the GPU takes ${formatSeconds(timer.asking_s)}, so batches of draws were timed.`);
  }
  words.push("Counters are exact, with one sample per pixel. The page does not use multisampling, with which some GPUs shade every sample, or the GPU's own statistics, which may include helper lanes.");
  if (device.fallback || /swiftshader|llvmpipe|lavapipe|basic render/i.test(`${device.description} ${device.architecture}`)) {
    words.push("This device is software on the processor: the browser did not provide a GPU.");
  }
  if (result.hidden) words.push("The page was hidden for a while. Browsers slow hidden pages down, so the rounds of that time were drawn again.");
  if (!profile) return words;
  const tiles = listTerms(profile).find((term) => term.name === "further_tiles");
  if (profile.law.form === "sum") words.push(tiles.shown ? "Time grows with the 64x64 tiles that triangles touch: the device sorts triangles into tiles, as tile-based GPUs do. A draw that is timed alone may cost more or less than within a frame."
    : "The cost of 64x64 tiles is not significant: no sign that the device sorts triangles into tiles.");
  if (profile.again.some((value) => value < 0.5)) {
    words.push(`Filling the same pixels a second time took ${joinWords(profile.again.map((value) => formatPercent(value)))} of the first time: the device may omit pixels that a later triangle covers.`);
  }
  const { drift, control } = profile;
  words.push(`Between the slowest and the fastest epoch of the measurement, the speed differed by a factor of ${drift.toFixed(2)}. `
    + `The same draw, timed under two names, differs by a factor of ${control.value.toFixed(3)} (${control.low.toFixed(3)} to ${control.high.toFixed(3)}).`);
  return words;
}

function svg(name, attributes, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/* An SVG chart of a triangle's time against its aspect at equal area; both axes are logarithmic (base 2). */
function drawAspectPanel(each) {
  const width = 360, height = 250, [left, right, top, bottom] = [34, 350, 12, 206];
  const most = Math.max(4, ...each.high, ...each.lanes) * 1.1, powers = [1, 2, 4, 8, 16, 32, 64].filter((value) => value <= most);
  const x = (aspect) => left + 12 + ((right - left - 24) * Math.log2(aspect)) / Math.log2(each.aspects.at(-1));
  const y = (ratio) => bottom - 12 - ((bottom - top - 24) * Math.log2(Math.max(ratio, 0.8))) / Math.log2(most);
  const line = (values, kind) => svg("polyline", { class: kind, points: values.map((value, k) => `${x(each.aspects[k])},${y(value)}`).join(" ") });
  const text = (words, at, kind = "") => svg("text", { ...at, class: kind }, words);
  return svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": describeThin(each) },
    ...powers.flatMap((value) => [svg("line", { class: value === 2 ? "twice" : "grid", x1: left, x2: right, y1: y(value), y2: y(value) }),
      text(String(value), { x: left - 6, y: y(value) + 4, "text-anchor": "end" })]),
    ...each.aspects.map((aspect) => text(`${aspect}:1`, { x: x(aspect), y: bottom + 16, "text-anchor": "middle" })),
    text("base / height", { x: (left + right) / 2, y: bottom + 36, "text-anchor": "middle" }),
    line(each.lanes, "lanes"), line(each.ratios, "measured"),
    ...each.ratios.flatMap((ratio, k) => [svg("line", { class: "measured", x1: x(each.aspects[k]), x2: x(each.aspects[k]), y1: y(each.low[k]), y2: y(each.high[k]) }),
      svg("circle", { class: "measured", cx: x(each.aspects[k]), cy: y(ratio), r: 3.2 })]),
    ...(each.doubled_at ? [text(`twice at ${each.doubled_at[0].toFixed(0)}:1`, { x: x(each.doubled_at[0]) - 6, y: y(2) - 6, "text-anchor": "end" }, "said")] : []));
}

function drawThin(profile) {
  $("thin").replaceChildren(...profile.aspects.map((each) => element("figure", {}, element("h3", {}, `Triangles of ${each.area} px²`), drawAspectPanel(each),
    element("figcaption", { class: "quiet" }, describeThin(each)))));
}

function drawTable(profile) {
  const terms = new Map(listTerms(profile).map((term) => [term.name, term]));
  const row = (term, stage) => element("tr", {}, element("th", { scope: "row" }, term.noun), element("td", {}, stage),
    element("td", { class: "number" }, term.shown ? formatSeconds(term.seconds) : "–"),
    element("td", { class: "number" }, `${formatSeconds(term.low)} to ${formatSeconds(term.high)}`));
  $("terms").replaceChildren(row(terms.get("draw"), ""), ...listStages(profile).flatMap(([stage, names]) => names.map((name) => row(terms.get(name), stage))));
  const { form, errors, r2_over, r2_within } = profile.law;
  $("r2").textContent = `Form: ${form}. Mean error of held-out groups of draws: ${Object.entries(errors).map(([name, error]) => `${name} ${formatPercent(error, 1)}`).join(", ")}. `
    + `R² of their log time: ${r2_over.toFixed(3)} over all, ${r2_within.toFixed(3)} within groups. A dash: not significant.`;
}

/* A sentence that says why the costs are unreliable, or "". */
function describeRefusal(profile) {
  if (profile.trouble) return `${profile.trouble} These times are unreliable: let the device cool, close other programs, and start again.`;
  const { r2_over, r2_within } = profile.law;
  return profile.refused ? `The law explains too little of the times (R² ${r2_over.toFixed(2)} over all draws, ${r2_within.toFixed(2)} within groups). These costs `
    + "are unreliable: close other programs, and start again with \"long\"." : "";
}

function describeAnswer(result) {
  const { profile } = state, name = deviceName(result, "this device");
  const counted = result.differing ? `Counters differ from the exact ones in ${count(result.differing)} of ${count(result.draws.length)} draws.`
    : `All counters of ${count(result.draws.length)} draws are the exact ones.`;
  if (!profile) return `On ${name}: ${counted} Too few rounds were timed to fit the costs of a triangle.${describeTimeLimit(result)}`;
  const differ = result.differing ? ` ${counted}` : "";
  if (describeRefusal(profile)) return `On ${name}: ${result.problem ? "the results below are unreliable." : describeRefusal(profile)}${differ}`;
  const terms = new Map(listTerms(profile).map((term) => [term.name, term]));
  const causes = Object.entries(STATED_COSTS).filter(([term]) => terms.get(term).shown).slice(0, MAX_STATED_COSTS)
    .map(([term, words], k) => `${words}${k ? "" : " costs"} ${formatSeconds(terms.get(term).seconds)}`);
  const doubled = profile.aspects.filter((each) => each.doubled_at).map((each) => `from ${each.doubled_at[0].toFixed(0)}:1 on at ${each.area} px²`);
  const thin = doubled.length ? `Thin triangles take twice as long ${joinWords(doubled)}.` : "Thin triangles take less than twice as long as others of equal area, up to 64:1.";
  const first = causes.length ? `On ${name}, ${joinWords(causes)}.` : `On ${name}:`;
  return `${first} ${thin}${differ}`;
}

/* A sentence with the rounds and epochs that a slow device completed within the time limit, or "" if all were completed. */
function describeTimeLimit(result) {
  if (!result.limited) return "";
  const rounds = sum(result.epochs), epochs = epochRanges(result).length;
  return rounds ? ` The time limit of ${LIMIT_S / 60} minutes ended the measurement after ${rounds} rounds in ${epochs} of ${EPOCHS} epochs: the intervals are wider.`
    : ` The device is too slow: the time limit of ${LIMIT_S / 60} minutes ended the measurement before the first round of all draws.`;
}

function show() {
  const { result, profile } = state;
  if (!result) return;
  showDevice(result);
  const items = (words) => words.filter(Boolean).map((text) => element("li", {}, text));
  $("traps").replaceChildren(...items([...describeCaveats(result, profile), describeTimeLimit(result)]));
  $("words").replaceChildren(...(profile ? items([...describeLaw(profile), ...describeAdvice(profile)]) : [element("li", { class: "empty" }, "Nothing timed yet.")]));
  for (const id of ["thin-section", "terms-section"]) $(id).hidden = !profile;
  if (profile) {
    drawThin(profile);
    drawTable(profile);
  }
}
