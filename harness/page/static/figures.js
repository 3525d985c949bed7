"use strict";
/* Statistics as in harness/metrics/statistics.py: medians, confidence intervals, paired ratios of two drawings, rank correlation. */

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}

const sum = (values) => values.reduce((total, value) => total + value, 0);
const mean = (values) => sum(values) / values.length;
const range = (size) => Array.from({ length: size }, (_, k) => k);

/* Variation of a log ratio between runs, in addition to the variation between rounds. */
const RUN_SCATTER = 0.003;
const NORMAL = 1.959963985;

/* Student's 97.5 % quantile by expansion in 1 / freedom (Abramowitz and Stegun, 26.7.5); error below 1 % from freedom 3 on. */
function student(freedom) {
  const z = NORMAL;
  return z + (z ** 3 + z) / (4 * freedom) + (5 * z ** 5 + 16 * z ** 3 + 3 * z) / (96 * freedom ** 2)
    + (3 * z ** 7 + 19 * z ** 5 + 17 * z ** 3 - 15 * z) / (384 * freedom ** 3);
}

/* The mean of independent values, and the bounds of Student's 95 % interval. */
function studentInterval(values) {
  const middle = mean(values), freedom = values.length - 1;
  const reach = student(freedom) * Math.sqrt(sum(values.map((value) => (value - middle) ** 2)) / freedom / values.length);
  return [middle, middle - reach, middle + reach];
}

const TAIL = 0.01, RESAMPLES = 1999;

/* Bounds of the 95 % interval of a mean by the studentised bootstrap with RESAMPLES resamples; quantiles at TAIL instead of
   0.025 correct the coverage for few values, see harness/metrics/statistics.py. */
function meanInterval(values, random = Math.random) {
  const meanAndError = (some) => {
    const middle = mean(some);
    return [middle, Math.sqrt(sum(some.map((value) => (value - middle) ** 2)) / (some.length - 1))];
  };
  const [middle, error] = meanAndError(values);
  if (values.length < 6 || !error) return [NaN, NaN];
  const distances = range(RESAMPLES).map(() => {
    const [own, apart] = meanAndError(values.map(() => values[Math.floor(random() * values.length)]));
    return (own - middle) / apart || 0;
  }).sort((p, q) => p - q);
  const [low, high] = [TAIL, 1 - TAIL].map((share) => distances[Math.ceil(share * RESAMPLES) - 1]);
  return [middle - high * error, middle - low * error];
}

/* Ratio of `samples` to `base`, paired by round: the mean over epochs of the median log ratio of each epoch, with
   Student's interval, one independent value per epoch. `scatter` widens the interval by the variation between runs;
   0 gives the interval of this run alone. */
function pairedRatio(samples, base, epochs, scatter = RUN_SCATTER) {
  const logs = samples.map((sample, round) => Math.log(sample / base[round]));
  const medians = [];
  let start = 0;
  for (const rounds of epochs) {
    const part = logs.slice(start, start + rounds);
    start += rounds;
    if (part.length) medians.push(median(part));
  }
  const middle = mean(medians);
  const freedom = medians.length - 1;
  const variance = medians.reduce((sum, value) => sum + (value - middle) ** 2, 0) / freedom;
  const own = freedom > 0 ? student(freedom) * Math.sqrt(variance / medians.length) : Infinity;
  const reach = Math.hypot(own, NORMAL * scatter);
  return { value: Math.exp(middle), low: Math.exp(middle - reach), high: Math.exp(middle + reach) };
}

/* Relative difference up to which neighbouring values share a rank: TIE_TOLERANCE of metrics/statistics.py. */
const TIE_TOLERANCE = 1e-9;

/* The rank of each value, counted from 1; values within TIE_TOLERANCE share the mean of their ranks. */
function ranks(values) {
  const order = values.map((_, k) => k).sort((i, j) => values[i] - values[j]);
  const isTie = (a, b) => b - a <= TIE_TOLERANCE * Math.max(Math.abs(a), Math.abs(b));
  const result = new Array(values.length);
  for (let start = 0, end = 1; start < order.length; start = end++) {
    while (end < order.length && isTie(values[order[end - 1]], values[order[end]])) end++;
    for (let k = start; k < end; k++) result[order[k]] = (start + 1 + end) / 2;
  }
  return result;
}

/* Spearman's rank correlation; null if it is undefined. */
function rankCorrelation(x, y) {
  const [p, q] = [ranks(x), ranks(y)];
  const [mp, mq] = [mean(p), mean(q)];
  let top = 0, left = 0, right = 0;
  for (let k = 0; k < p.length; k++) {
    top += (p[k] - mp) * (q[k] - mq);
    left += (p[k] - mp) ** 2;
    right += (q[k] - mq) ** 2;
  }
  return x.length < 3 || !left || !right ? null : top / Math.sqrt(left * right);
}
