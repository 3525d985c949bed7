"use strict";
/* Counts, then times, view by view; keeps what was measured whatever happens; offers it as one file. */

const PACE = { quick: 0.6, usual: 4, long: 10 };
const RESULT = "raster-harness device result";
const VERSION = 1;

const pause = () => new Promise((done) => setTimeout(done));

function frameOf(view, step) {
  const points = snapped(decode(view.points, Int32Array), step);
  const owner = new Uint32Array(points.length / 2);
  let at = 0;
  view.sizes.forEach((size, polygon) => { owner.fill(polygon, at, at + size); at += size; });
  return { size: view.resolution, points, owner, polygons: view.sizes.length };
}

function progress(share, text) {
  $("progress").value = share;
  $("doing").textContent = text;
}

/* Left: seconds; the bar counts a view's counting as a tenth of its timing. */
function left(seconds) {
  if (seconds < 1) return "almost done";
  return seconds < 90 ? `about ${Math.ceil(seconds)} s left` : `about ${Math.round(seconds / 60)} min left`;
}

async function measure() {
  const { page } = state;
  const budget = PACE[$("pace").value];
  const { device, info } = await openDevice();
  device.addEventListener("uncapturederror", (event) => { state.problem ??= event.error.message; });
  const result = { format: RESULT, version: VERSION, page: { harness: page.harness, scene: page.scene, created: page.created },
    started: new Date().toISOString(), browser: navigator.userAgent, device: info, timer: null, budget_s: budget, complete: false,
    problem: null, hidden: document.hidden, views: [] };
  state.result = result;
  const painter = new Painter(device, info, page.shaders);
  const lost = device.lost.then((why) => `The browser lost the GPU (${why.message || why.reason}).`);
  try {
    // Whatever is waited for ends when the device is lost.
    await Promise.race([measureAll(result, painter, budget), lost.then((why) => { throw new Error(why); })]);
  } catch (error) {
    // What fails because the device is lost may be heard of first; a busy browser takes its time.
    const later = new Promise((resolve) => setTimeout(resolve, 1000));
    throw new Error(await Promise.race([lost, later.then(() => error.message)]));
  } finally {
    device.destroy();
  }
}

async function measureAll(result, painter, budget) {
  const { page } = state;
  const fitting = page.views.filter((view) => view.resolution <= painter.device.limits.maxTextureDimension2D);
  const steps = fitting.map((view) => Object.keys(view.cases).length + 3);
  const total = sum(steps) * budget * 1.15;
  const begun = timing.clock();
  const step = (result.device.step = await findStep(painter)) ?? 1;
  let before = 0;
  const told = (share, what) => progress(Math.min(1, (before + share) / sum(steps)),
    `${what}; ${left(Math.max(0, total - (timing.clock() - begun)))}`);
  for (const [number, view] of fitting.entries()) {
    const { points, sizes, cases, ...about } = view;
    const frame = frameOf(view, step);
    const found = { ...about, cases: {}, times: null, epochs: [] };
    result.views.push(found);
    const rows = new Map();
    for (const [name, each] of Object.entries(cases)) {
      told(0, `${conditionOf(view)}: counting ${name}`);
      rows.set(name, decode(each.rows, Uint32Array));
      const counters = await painter.count(frame, rows.get(name));
      const expected = step === 1 ? { fragments: decode(each.fragments, Uint32Array), quads: decode(each.quads, Uint32Array) }
        : countExactly(frame, rows.get(name));
      found.cases[name] = { record: each.record, counters, differing: differingOf(counters, expected) };
      show();
      await pause();
      if (state.stop) return;
    }
    if (!result.timer) {
      told(0, "testing the timers");
      const [big, nothing] = [layers(painter, SELF_TEST_PX, 32), layers(painter, SELF_TEST_PX, 0)];
      result.timer = await selfTest(big, nothing);
      for (const drawing of [big, nothing]) drawing.close();
      show();
    }
    await time(found, frame, rows, painter, budget, result.timer, (share) => told(share * steps[number], `${conditionOf(view)}: timing`));
    before += steps[number];
    if (state.stop) return;
  }
  result.complete = true;
}

async function time(found, frame, rows, painter, budget, test, told) {
  const corner = { size: frame.size, points: new Int32Array([0, 0, 256 * frame.size, 0, 0, 256 * frame.size]), owner: new Uint32Array(3) };
  const again = rows.has(state.page.base) ? [[AGAIN, [frame, rows.get(state.page.base)]]] : [];
  const drawn = new Map([[EMPTY, [frame, new Uint32Array(0)]], [REFERENCE, [corner, new Uint32Array([0, 1, 2])]],
    ...[...rows].map(([name, each]) => [name, [frame, each]]), ...again]);
  let open = new Map();
  const prepare = async (order) => {
    for (const drawing of open.values()) drawing.close();
    open = new Map();
    for (const name of order) open.set(name, painter.prepare(...drawn.get(name)));
    return open;
  };
  const settings = { budget_s: budget, min_batch_s: 1e-3, warm_up_s: Math.min(0.3, budget / 4) };
  let shown = timing.clock();
  const report = (share) => {
    told(share);
    if (timing.clock() - shown > 2) { shown = timing.clock(); show(); }
  };
  await timeTogether([...drawn.keys()], prepare, settings, test, report, () => state.stop, found);
  for (const drawing of open.values()) drawing.close();
  show();
}

async function start() {
  state.running = true;
  state.stop = false;
  state.hidden = false;
  state.problem = null;
  document.documentElement.dataset.state = "measuring";
  for (const [id, off] of [["start", true], ["pace", true], ["stop", false], ["notice", false]]) $(id).disabled = off;
  $("notice").hidden = true;
  try {
    await measure();
  } catch (error) {
    state.problem = error.message;
  }
  state.running = false;
  const { result } = state;
  if (result) {
    result.ended = new Date().toISOString();
    result.problem = state.problem;
    result.hidden ||= state.hidden;
  }
  const counted = result?.views.some((view) => Object.keys(view.cases).length);
  const end = state.problem ?? (result?.complete ? "" : "Stopped. What was measured is kept.");
  $("notice").textContent = state.problem && counted ? `${end} What was measured is kept; start again for the rest.` : end;
  $("notice").hidden = !end;
  $("answer").textContent = counted ? answerOf(result) : "Nothing was measured.";
  progress(result?.complete ? 1 : $("progress").value, result?.complete ? "done" : "not finished");
  $("stop").disabled = true;
  for (const id of ["start", "pace"]) $(id).disabled = false;
  $("save").disabled = !counted;
  show();
  document.documentElement.dataset.state = result?.complete ? "done" : "ended";
}

function fileName() {
  const told = state.result.device;
  const words = `${state.page.scene} ${told.description || `${told.vendor} ${told.architecture}`}`;
  return `${words.toLowerCase().replaceAll(/[^a-z0-9]+/g, "-").replaceAll(/^-|-$/g, "")}.json`;
}

/* The result as text, and its digest, by which `harness import` sees whether the file is whole. */
async function savedText() {
  const text = JSON.stringify(state.result);
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", new TextEncoder().encode(text)));
  const sha256 = [...digest].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  return JSON.stringify({ format: RESULT, version: VERSION, sha256, result: text });
}

async function save() {
  const link = element("a", { download: fileName(), href: URL.createObjectURL(new Blob([await savedText()], { type: "application/json" })) });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

async function open() {
  state.page = await unpack();
  $("start").addEventListener("click", start);
  $("stop").addEventListener("click", () => { state.stop = true; });
  $("save").addEventListener("click", save);
  document.addEventListener("visibilitychange", () => { state.hidden ||= document.hidden && state.running; });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  let waiting = 0;
  addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(drawCharts, 100); });
  document.documentElement.dataset.ready = String(Math.round(performance.now()));
  if (!location.hash.includes("wait")) await start();
}

open();
