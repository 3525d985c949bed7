"use strict";
/* The measurement of a run's triangulations: each view is counted, then timed. */

const PACE = { quick: 0.6, usual: 4, long: 10 };
const RESULT = "raster-harness device result";
const VERSION = 1;

const describePage = () => ({ harness: state.page.harness, scene: state.page.scene, created: state.page.created });
const makeEmptyResult = () => ({ views: [] });
const hasMeasurements = (result) => result.views.some((view) => Object.keys(view.cases).length);
const conclude = async () => {};
const nameSubject = () => state.page.scene;

function makeFrame(view, step) {
  const points = snapPoints(decode(view.points, Int32Array), step);
  const owner = new Uint32Array(points.length / 2);
  let at = 0;
  view.sizes.forEach((size, polygon) => { owner.fill(polygon, at, at + size); at += size; });
  return { size: view.resolution, points, owner, polygons: view.sizes.length };
}

async function measureAll(result, painter, budget) {
  const { page } = state;
  const fitting = page.views.filter((view) => view.resolution <= painter.device.limits.maxTextureDimension2D);
  const steps = fitting.map((view) => Object.keys(view.cases).length + 3);
  const total = sum(steps) * budget * 1.15;
  const begun = timing.clock();
  const step = (result.device.step = await findStep(painter)) ?? 1;
  let before = 0;
  const reportShare = (share, what) => progress(Math.min(1, (before + share) / sum(steps)),
    `${what}; ${left(Math.max(0, total - (timing.clock() - begun)))}`);
  for (const [number, view] of fitting.entries()) {
    const { points, sizes, cases, ...about } = view;
    const frame = makeFrame(view, step);
    const found = { ...about, cases: {}, times: null, epochs: [] };
    result.views.push(found);
    const rows = new Map();
    for (const [name, each] of Object.entries(cases)) {
      reportShare(0, `${conditionOf(view)}: counting ${name}`);
      rows.set(name, decode(each.rows, Uint32Array));
      const counters = await painter.count(frame, rows.get(name));
      const expected = step === 1 ? Object.fromEntries(COUNTERS.map((counter) => [counter, decode(each[counter], Uint32Array)]))
        : countExactly(frame, rows.get(name));
      found.cases[name] = { record: each.record, counters, differing: countDifferences(counters, expected) };
      show();
      await pause();
      if (state.stop) return;
    }
    if (!result.timer) {
      reportShare(0, "testing the timers");
      await testTimers(result, painter);
      show();
    }
    await time(found, frame, rows, painter, budget, result.timer, (share) => reportShare(share * steps[number], `${conditionOf(view)}: timing`));
    before += steps[number];
    if (state.stop) return;
  }
  result.complete = true;
}

async function time(found, frame, rows, painter, budget, test, reportShare) {
  const corner = { size: frame.size, points: new Int32Array([0, 0, 256 * frame.size, 0, 0, 256 * frame.size]), owner: new Uint32Array(3) };
  const again = rows.has(state.page.base) ? [[AGAIN, [frame, rows.get(state.page.base)]]] : [];
  const drawn = new Map([[EMPTY, [frame, new Uint32Array(0)]], [REFERENCE, [corner, new Uint32Array([0, 1, 2])]],
    ...[...rows].map(([name, each]) => [name, [frame, each]]), ...again]);
  const prepare = makePrepare(painter, drawn);
  const settings = { budget_s: budget, min_batch_s: 1e-3, warm_up_s: Math.min(0.3, budget / 4) };
  let shown = timing.clock();
  const report = (share) => {
    reportShare(share);
    if (timing.clock() - shown > 2) { shown = timing.clock(); show(); }
  };
  await timeTogether([...drawn.keys()], prepare, settings, test, report, () => state.stop, found);
  await prepare([]);
  show();
}

open();
