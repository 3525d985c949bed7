"use strict";
/* Evaluation of a profile's times, as in harness/profile/measured.py and advice.py: seconds of each draw, time against
   aspect, recommended triangulator. Only Python computes the triangulations that are optimal for the device. */

const CONTROL = "(control)";
const MAX_DRIFT = 1.5, MAX_CONTROL_DIFFERENCE = 0.03, MIN_R2 = 0.88, MIN_EPOCHS = 4;

/* [first, last + 1] round of each epoch, epochs without rounds excluded. */
function epochRanges(result) {
  let at = 0;
  return result.epochs.map((rounds) => [at, (at += rounds)]).filter(([first, last]) => last > first);
}

/* Seconds of each draw in each epoch, without the changes of speed that all draws of a round share; the ratio of the control
   draw to the same draw under its own name; the drift, max / min of the speed over epochs; and the seconds of an empty draw. */
function normaliseTimes(result, size) {
  const parts = epochRanges(result);
  const logs = range(size).map((name) => result.times[name].samples_s.map((value) => Math.log(Math.max(value, 1e-12))));
  const levels = logs[0].map((_, round) => mean(logs.map((row) => row[round])));
  const speeds = parts.map(([first, last]) => mean(levels.slice(first, last))), middle = mean(speeds);
  const epochs = parts.map(([first, last]) =>
    logs.map((row) => Math.exp(median(range(last - first).map((k) => row[first + k] - levels[first + k])) + middle)));
  const control = parts.length < 2 ? null : pairedRatio(result.times[CONTROL].samples_s, result.times[size >> 1].samples_s,
    parts.map(([first, last]) => last - first), 0);
  return { epochs, control, drift: Math.exp(Math.max(...speeds) - Math.min(...speeds)), empty_s: median(result.times[EMPTY].samples_s) };
}

/* A sentence that says why the times are unreliable, or "". */
function describeDisturbance({ drift, control }) {
  if (drift > MAX_DRIFT) return `The device's speed changed by a factor of ${drift.toFixed(2)} during the measurement (heat, or other programs).`;
  const apart = control && Math.min(Math.abs(control.low - 1), Math.abs(control.high - 1));
  if (control && (control.low > 1 || control.high < 1) && apart > MAX_CONTROL_DIFFERENCE) {
    return `The same draw, timed under two names, differs by a factor of ${control.value.toFixed(3)}.`;
  }
  return "";
}

/* The counters (draws, terms) to which the law is fitted, from the exact results of a vertex grid. */
const makeDesignRows = (page, counters, size) => range(size).map((k) => Object.keys(page.terms).map((name) =>
  (name === "draw" ? 1 : counters[name][k] / (page.in_px.includes(name) ? UNIT : 1))));

/* [aspect, low, high] at which thin triangles take twice as long, interpolated; null if the aspects do not reach it. */
function findDoubling(ratios, aspects) {
  const found = ratios.map((epoch) => {
    const place = epoch.findIndex((ratio) => ratio >= 2);
    if (place < 1) return null;
    const [low, high] = [epoch[place - 1], epoch[place]].map(Math.log2), [from, to] = [aspects[place - 1], aspects[place]].map(Math.log2);
    return from + ((1 - low) / (high - low)) * (to - from);
  });
  return found.includes(null) ? null : studentInterval(found).map((end) => 2 ** end);
}

/* For each area: time and shaded lanes of thin triangles, relative to triangles of aspect 1. */
function compareAspects(page, design, measured) {
  const names = Object.keys(page.terms), lane = names.indexOf("helper_lanes"), pixel = names.indexOf("fragments");
  const distinct = (values) => [...new Set(values)].filter(Boolean);
  return distinct(page.draws.map((draw) => draw.area)).map((area) => {
    const aspects = distinct(page.draws.map((draw) => draw.aspect));
    const places = aspects.map((aspect) => range(page.draws.length).filter((k) => page.draws[k].area === area && page.draws[k].aspect === aspect));
    const net = measured.epochs.map((epoch) => places.map((own) => {
      const time = mean(own.map((k) => epoch[k]));
      return Math.max(time - measured.empty_s, 1e-3 * time);
    }));
    const ratios = net.map((row) => row.map((value) => value / row[0]));
    const ends = aspects.map((_, a) => studentInterval(ratios.map((row) => Math.log(row[a]))).map(Math.exp));
    const counts = places.map((own) => names.map((_, j) => mean(own.map((k) => design[k][j]))));
    const shaded = counts.map((row) => row[pixel] + row[lane]);
    return { area, aspects, ratios: ends.map((end) => end[0]), low: ends.map((end) => end[1]), high: ends.map((end) => end[2]),
      lanes: shaded.map((value) => value / shaded[0]), doubled_at: findDoubling(ratios, aspects) };
  });
}

/* The triangulator with the lowest predicted time, the extra time (regret) of each triangulator, and the share of ear clipping's
   time saved on each scene; null if no cost is positive. */
function chooseTriangulator(page, coefficients, random = Math.random) {
  const own = coefficients.slice(1);
  if (!own.some((value) => value > 0)) return null;
  const costs = Object.entries(page.scenes).map(([scene, each]) => [scene,
    Object.fromEntries(Object.entries(each).map(([name, rows]) => [name, rows.map((row) => dot(row, own))]))]);
  const names = Object.keys(page.criteria);
  const least = (each) => Math.min(...names.map((name) => sum(each[name])));
  const regret = Object.fromEntries(names.map((name) => [name, mean(costs.map(([, each]) => sum(each[name]) / least(each) - 1))]));
  const chosen = names.reduce((best, name) => (regret[name] < regret[best] ? name : best));
  const saved = costs.map(([scene, each]) => {
    const logs = each[chosen].map((value, k) => Math.log(value / each[page.base][k]));
    const [low, high] = meanInterval(logs, random);
    return { scene, value: 1 - Math.exp(mean(logs)), low: 1 - Math.exp(high), high: 1 - Math.exp(low) };
  });
  return costs.length ? { triangulator: chosen, regret, saved } : null;
}

/* For each form of the law, a row for each stage: 1 for the terms that count in the stage, else 0. */
const listMembers = (page) => mapValues(page.forms, (stages) => Object.values(stages).map((terms) =>
  Object.keys(page.terms).map((name) => Number(name === "draw" || terms.includes(name)))));

/* The normalised times, law, recommendation and warnings of a measurement; null if fewer than MIN_EPOCHS epochs were timed. */
function makeProfile(page, result) {
  const size = page.draws.length;
  if (!result.times || epochRanges(result).length < MIN_EPOCHS) return null;
  const measured = normaliseTimes(result, size), grid = page.grids[result.device.step ?? 1];
  const design = makeDesignRows(page, grid.counters, size);
  const { places } = page.fitted;
  const pick = (rows) => places.map((k) => rows[k]);
  const law = fitLaw(pick(design), measured.epochs.map(pick), page.fitted, listMembers(page));
  const seconds = range(size).map((k) => Math.exp(mean(measured.epochs.map((row) => Math.log(row[k])))));
  // Draws bound by vertices are excluded: their times depend on the order of triangles, not on the criteria.
  const stages = Object.values(page.forms[law.form]);
  const isBound = (k) => stages[law.binding[places.indexOf(k)]].join() === page.vertices.join();
  const shape = range(page.plain.places.length).filter((index) => !isBound(page.plain.places[index]));
  const ofShape = (values) => shape.map((index) => values[page.plain.places[index]]);
  const coefficients = fitCoefficients(ofShape(grid.predicted), ofShape(seconds), rankDistinct(shape.map((index) => page.plain.labels[index])));
  const twice = range(size).filter((k) => page.draws[k].kind === "twice").map((k) => seconds[k] - measured.empty_s);
  return { ...measured, law, coefficients, aspects: compareAspects(page, design, measured), advice: chooseTriangulator(page, coefficients),
    again: range(twice.length / 2).map((k) => twice[2 * k + 1] / twice[2 * k] - 1), trouble: describeDisturbance(measured),
    refused: !(law.r2_over >= MIN_R2 && law.r2_within >= MIN_R2) };
}
