"use strict";
/* The measurement of a profile: the draws are generated, counted and timed, and the law is fitted, also after an error. */

const PACE = { quick: 0.1, usual: 0.5, long: 1.5 };
const RESULT = "raster-harness device profile";
const VERSION = 1;
const LIMIT_S = 240;

const describePage = () => ({ harness: state.page.harness, design: state.page.design, seed: state.page.seed });
const makeEmptyResult = () => ({ draws: [], differing: 0, limited: false, times: null, epochs: [], law: null });
const hasMeasurements = (result) => result.draws.length > 0;
const nameSubject = () => "profile";
const drawCharts = () => {};

async function measureAll(result, painter, budget) {
  const { page } = state;
  state.profile = null;
  if (painter.device.limits.maxTextureDimension2D < SIDE) throw new Error(`The GPU does not support a viewport of ${SIDE} px.`);
  progress(0, "making the draws");
  await pause();
  const grid = (result.device.step = await findStep(painter)) ?? 1;
  const frames = makeDesign(page.seed).map(({ points, rows }, k) => [{ size: SIDE, points: Int32Array.from(snapPoints(points, grid)),
    owner: new Uint32Array(points.length / 2), polygons: 1, work: page.draws[k].work }, Uint32Array.from(rows)]);
  const expected = page.grids[grid], sums = frames.map(([frame, rows]) => computeChecksum({ points: frame.points, rows }));
  if (sums.some((value, k) => value !== expected.checksums[k])) throw new Error("This browser generated draws that differ from the expected ones (checksum mismatch).");
  for (const [k, [frame, rows]] of frames.entries()) {
    if (k % 10 === 0) progress(0.1 * (k / frames.length), `counting draw ${k + 1} of ${frames.length}`);
    const { fragments: [fragments], quads: [quads] } = await painter.count(frame, rows);
    result.draws.push({ checksum: sums[k], fragments, quads });
    result.differing += Number(fragments !== expected.counters.fragments[k] || quads !== expected.counters.quads[k]);
    if (state.stop) return;
  }
  progress(0.1, "testing the timers");
  await testTimers(result, painter);
  show();
  await time(result, frames, painter, budget);
  result.complete = !state.stop;
}

async function time(result, frames, painter, budget) {
  const [first] = frames[0], names = frames.map((_, k) => String(k));
  const drawn = new Map([...frames.map((each, k) => [names[k], each]), [CONTROL, frames[frames.length >> 1]], [EMPTY, [first, new Uint32Array(0)]]]);
  const settings = { budget_s: budget, min_batch_s: 2e-3, warm_up_s: 0.02, paired: false, limit_s: LIMIT_S, away };
  const begun = timing.clock(), total = Math.min(LIMIT_S, 1.1 * budget * drawn.size);
  const reportShare = (share) => progress(0.1 + 0.85 * share, `timing: ${sum(result.epochs)} rounds; ${left(Math.max(0, total - (timing.clock() - begun)))}`);
  let seen = 0;
  const stopped = () => {
    const epochs = epochRanges(result).length;
    // After each epoch: a device whose speed changes (heat) ends the measurement, as its times cannot be fitted.
    if (epochs > Math.max(seen, 1)) {
      const { drift } = normaliseTimes(result, frames.length);
      if (drift > MAX_DRIFT) throw new Error(describeDisturbance({ drift }));
    }
    seen = epochs;
    return state.stop;
  };
  state.wasHidden = document.hidden;
  const prepare = makePrepare(painter, drawn);
  await timeTogether([...drawn.keys()], prepare, settings, result.timer, reportShare, stopped, result);
  result.limited = result.epochs.length < EPOCHS && !state.stop;
  await prepare([]);
}

/* Wait until the page is visible; return the seconds waited, or 0 if the page was visible since the last call. */
async function away() {
  if (!state.wasHidden && !document.hidden) return 0;
  const begun = timing.clock();
  while (document.hidden) {
    $("notice").textContent = "The measurement waits until this page is visible, because browsers slow hidden pages down.";
    $("notice").hidden = false;
    await new Promise((seen) => document.addEventListener("visibilitychange", seen, { once: true }));
  }
  $("notice").hidden = true;
  state.wasHidden = false;
  return timing.clock() - begun + 1e-9;
}

/* Fit the law to the completed rounds, also after an error or a stop. */
async function conclude(result) {
  progress(0.95, "fitting the law");
  await pause();
  state.profile = makeProfile(state.page, result);
  if (state.profile) {
    const { form, seconds, r2_over, r2_within } = state.profile.law;
    result.law = { form, seconds: Object.fromEntries(Object.keys(state.page.terms).map((name, j) => [name, seconds[j]])), r2_over, r2_within };
  }
}

document.addEventListener("visibilitychange", () => { state.wasHidden ||= document.hidden; });
open();
