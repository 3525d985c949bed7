"use strict";
/* Timing as in harness/measuring/timing.py: shuffled interleaved rounds, in epochs before which all drawings
   are prepared again. A drawing has `sample(repeats)`, a promise of {wall, gpu} seconds. */

const EMPTY = "(empty)", REFERENCE = "(reference)";
const AGREEMENT = 0.3, MIN_ROUNDS = 12, EPOCH_ROUNDS = 2, EPOCHS = 12, MAX_BATCH_FACTOR = 10;
const MAX_REPEATS = 512;

const timing = { clock: () => performance.now() / 1000 };

const selectSeconds = (sample, timer) => (timer === "gpu" ? sample.gpu : sample.wall);

function shuffle(values, random) {
  for (let k = values.length - 1; k > 0; k--) {
    const other = Math.floor(random() * (k + 1));
    [values[k], values[other]] = [values[other], values[k]];
  }
}

/* The smallest visible step of the wall clock, in seconds. */
function clockResolution() {
  let smallest = Infinity;
  for (let k = 0; k < 20; k++) {
    const first = timing.clock();
    let second = first;
    while (second <= first) second = timing.clock();
    smallest = Math.min(smallest, second - first);
  }
  return smallest;
}

/* Resolution of the GPU's timer in seconds, the common divisor of its times: browsers round times to about 0.1 ms. */
function findTimerStep(nanoseconds) {
  let step = 0;
  for (let value of nanoseconds) {
    value = Math.round(value);
    while (value) [step, value] = [value, step % value];
  }
  return Math.max(step, 1) * 1e-9;
}

/* Select the timer with a large drawing; the GPU's timer is used only if the wall clock agrees to within AGREEMENT.
   empty : a drawing without triangles, whose wall time is the cost of a request */
async function selectTimer(big, empty) {
  const asking = [];
  for (let k = 0; k < 5; k++) asking.push((await empty.sample(1)).wall);
  const cost = median(asking);
  let repeats = 1;
  while ((await big.sample(repeats)).wall < Math.max(0.03, 10 * cost) && repeats < MAX_REPEATS) repeats *= 2;
  const samples = [];
  for (let k = 0; k < 5; k++) samples.push(await big.sample(repeats));
  const wall = Math.max(median(samples.map((each) => each.wall)) - cost, 1e-9) / repeats;
  const test = { timer: "wall", asking_s: cost, wall_s: wall, gpu_s: null, resolution_s: Math.max(clockResolution(), cost / 20) };
  const seen = samples.filter((each) => each.gpu !== null);
  if (!seen.length) return { ...test, reason: "the device has no GPU timer" };
  test.gpu_s = median(seen.map((each) => each.gpu)) / repeats;
  const figures = `${(test.gpu_s * 1e3).toFixed(3)} ms of a draw that took ${(wall * 1e3).toFixed(3)} ms`;
  if (!(Math.abs(test.gpu_s - wall) <= AGREEMENT * wall)) {
    return { ...test, reason: `the driver's GPU timer disagrees: ${figures}` };
  }
  const step = findTimerStep(seen.map((each) => each.gpu * 1e9));
  return { ...test, timer: "gpu", resolution_s: step, reason: `the GPU timer saw ${figures}` };
}

/* Draw until times are stable; return the number of draws that take `batch` seconds, and the seconds per draw. */
async function warmUp(drawing, batch, limit, timer) {
  const deadline = timing.clock() + limit;
  // The first draw is discarded: its additional time might exceed a batch.
  await drawing.sample(1);
  let repeats = 1;
  let seconds = selectSeconds(await drawing.sample(repeats), timer);
  while (seconds < batch && repeats < MAX_REPEATS) {
    const wanted = seconds > 0 ? (1.2 * batch) / seconds : 8;
    repeats = Math.min(MAX_REPEATS, Math.max(repeats + 1, Math.floor(repeats * Math.min(wanted, 8))));
    seconds = selectSeconds(await drawing.sample(repeats), timer);
  }
  const three = async () => {
    const taken = [];
    for (let k = 0; k < 3; k++) taken.push(selectSeconds(await drawing.sample(repeats), timer));
    return median(taken);
  };
  let recent = await three();
  while (timing.clock() < deadline) {
    const newer = await three();
    if (Math.abs(newer - recent) <= 0.02 * recent) break;
    recent = newer;
  }
  return [repeats, recent / repeats];
}

/* Time all drawings together.

   prepare(order) destroys the drawings and returns a Map of new ones, made in this order;
   settings : {budget_s, min_batch_s, warm_up_s}, optionally {paired}: whether the batches of all drawings have equally many draws;
   {limit_s}: time limit, whatever the number of rounds; {away}: called after each round, promises the seconds for which
   the page was hidden; such a round is discarded. reportShare(share) is called with the completed share, 0 to 1;
   stopped() returns true to end after the current round. Fills found.times, {name: {repeats, samples_s}}, and
   found.epochs, the number of rounds of each epoch, during the measurement. */
async function timeTogether(names, prepare, settings, test, reportShare, stopped, found, random = Math.random) {
  const { paired = true, limit_s = Infinity, away = () => 0 } = settings;
  let gone = 0;
  const now = () => timing.clock() - gone;
  const start = now();
  // A batch costs the browser milliseconds of overhead, so shorter batches would waste the budget.
  const batch = Math.max(settings.min_batch_s, 100 * test.resolution_s, 3 * test.asking_s);
  const budget = settings.budget_s * names.length;
  let drawings = await prepare(names);
  const times = (found.times = {}), drawn = {};
  const epochs = (found.epochs = [0]);
  for (const name of names) {
    const [repeats, seconds] = await warmUp(drawings.get(name), batch, settings.warm_up_s, test.timer);
    times[name] = { repeats, samples_s: [] };
    drawn[name] = seconds;
    reportShare(Math.min(0.3, (now() - start) / budget));
    gone += await away();
    if (stopped() || now() - start > limit_s) return;
  }
  const compared = names.filter((name) => name !== EMPTY && name !== REFERENCE);
  const most = Math.max(...compared.map((name) => times[name].repeats));
  for (const name of paired ? compared : []) {
    const fits = Math.floor((MAX_BATCH_FACTOR * batch) / Math.max(drawn[name], 1e-12));
    times[name].repeats = Math.min(most, Math.max(times[name].repeats, fits));
  }
  const begun = now();
  const epoch = Math.max(0, start + budget - begun) / EPOCHS;
  // On a slow device, rounds of different epochs are more informative than rounds of one epoch.
  const round = sum(names.map((name) => drawn[name] * times[name].repeats));
  const least = EPOCHS * (EPOCH_ROUNDS + 1) * round > limit_s - (begun - start) ? 1 : EPOCH_ROUNDS;
  let until = begun + epoch;
  const order = [...names];
  for (;;) {
    if (epochs.at(-1) >= least && now() >= until) {
      if (epochs.length >= EPOCHS && times[names[0]].samples_s.length >= MIN_ROUNDS) break;
      shuffle(order, random);
      drawings = await prepare(order);
      for (const name of order) await drawings.get(name).sample(1);
      epochs.push(0);
      until = Math.max(until + epoch, now());
    }
    shuffle(order, random);
    const seconds = {};
    for (const name of order) {
      const { repeats } = times[name];
      seconds[name] = selectSeconds(await drawings.get(name).sample(repeats), test.timer) / repeats;
    }
    const unseen = await away();
    gone += unseen;
    // Incomplete rounds are discarded.
    if (!unseen) {
      for (const name of names) times[name].samples_s.push(seconds[name]);
      epochs[epochs.length - 1] += 1;
    }
    reportShare(Math.min(1, (now() - start) / budget));
    if (stopped() || now() - start > limit_s) break;
  }
}
