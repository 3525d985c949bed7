"use strict";
/* A measurement from its start to the saved file, also after errors. The script of each page defines PACE, RESULT,
   VERSION, describePage, makeEmptyResult, measureAll, hasMeasurements, conclude, describeAnswer, show, drawCharts and nameSubject. */

const state = { page: null, result: null, running: false, stop: false, dark: false };

const count = (value) => Math.round(value).toLocaleString("en-GB");
const digits = (value, wanted = 3) => (value >= 1000 ? count(value) : value.toPrecision(wanted));
const pause = () => new Promise((done) => setTimeout(done));

function progress(share, text) {
  $("progress").value = share;
  $("doing").textContent = text;
}

function left(seconds) {
  if (seconds < 1) return "almost done";
  return seconds < 90 ? `about ${Math.ceil(seconds)} s left` : `about ${Math.round(seconds / 60)} min left`;
}

async function measure() {
  const budget = PACE[$("pace").value];
  const { device, info } = await openDevice();
  device.addEventListener("uncapturederror", (event) => { state.problem ??= event.error.message; });
  const result = { format: RESULT, version: VERSION, page: describePage(), started: new Date().toISOString(), browser: navigator.userAgent,
    device: info, timer: null, budget_s: budget, complete: false, problem: null, hidden: document.hidden, ...makeEmptyResult() };
  state.result = result;
  const painter = new Painter(device, info, state.page.shaders);
  const lost = device.lost.then((why) => `The browser lost the GPU (${why.message || why.reason}).`);
  try {
    // Promises of a lost device may stay pending, so its loss ends the measurement.
    await Promise.race([measureAll(result, painter, budget), lost.then((why) => { throw new Error(why); })]);
  } catch (error) {
    // Running measurements end with the current round.
    state.stop = true;
    // The loss of the device may be reported after the failure that it caused, so wait for it.
    const later = new Promise((resolve) => setTimeout(resolve, 1000));
    throw new Error(await Promise.race([lost, later.then(() => error.message)]));
  } finally {
    device.destroy();
  }
}

async function testTimers(result, painter) {
  const [big, empty] = [layers(painter, SELF_TEST_PX, 32), layers(painter, SELF_TEST_PX, 0)];
  result.timer = await selectTimer(big, empty);
  for (const drawing of [big, empty]) drawing.close();
}

/* Return the function `prepare` for timeTogether. drawn: Map of name -> [frame, rows]. */
function makePrepare(painter, drawn) {
  let open = new Map();
  return async (order) => {
    for (const drawing of open.values()) drawing.close();
    open = new Map();
    for (const name of order) open.set(name, painter.prepare(...drawn.get(name)));
    return open;
  };
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
  const any = Boolean(result && hasMeasurements(result));
  if (any) await conclude(result);
  const end = state.problem ?? (result?.complete ? "" : "Stopped. Completed measurements are kept.");
  $("notice").textContent = state.problem && any ? `${end} Completed measurements are kept; start again to measure everything.` : end;
  $("notice").hidden = !end;
  $("answer").textContent = any ? describeAnswer(result) : "Nothing was measured.";
  progress(result?.complete ? 1 : $("progress").value, result?.complete ? "done" : "not finished");
  $("stop").disabled = true;
  for (const id of ["start", "pace"]) $(id).disabled = false;
  $("save").disabled = !any;
  show();
  document.documentElement.dataset.state = result?.complete ? "done" : "ended";
}

const deviceName = ({ device }, unnamed) => device.description || [device.vendor, device.architecture].filter(Boolean).join(" ") || unnamed;

function showDevice(result) {
  const { device, timer } = result;
  const facts = [["GPU", device.description || [device.vendor, device.architecture, device.device].filter(Boolean).join(" ") || "not reported by the browser"],
    ["Browser", navigator.userAgent], ["Timer", timer ? `${timer.timer === "gpu" ? "the GPU's" : "the wall clock"}, in steps of ${timer.resolution_s < 1e-6 ? `${digits(timer.resolution_s * 1e9, 2)} ns` : `${digits(timer.resolution_s * 1e6, 3)} µs`}` : "not tested yet"],
    ["Grid", device.step ? `1/${256 / device.step} px${device.step > 1 ? ", coarser than the reference's 1/256 px: vertices were moved to this grid" : ""}` : "not known yet"],
    ["Largest viewport", `${count(device.limits.maxTextureDimension2D)} px`]];
  $("device").replaceChildren(...facts.flatMap(([term, what]) => [element("dt", {}, term), element("dd", {}, what)]));
}

function fileName() {
  const gpuInfo = state.result.device;
  const words = `${nameSubject()} ${gpuInfo.description || `${gpuInfo.vendor} ${gpuInfo.architecture}`}`;
  return `${words.toLowerCase().replaceAll(/[^a-z0-9]+/g, "-").replaceAll(/^-|-$/g, "")}.json`;
}

/* The result as text, and its digest, by which `raster-harness import` detects modified files. */
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
