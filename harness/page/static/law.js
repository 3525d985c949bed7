"use strict";
/* A device's law, as harness/profile/law.py and cost_terms.py fit it: a sum of costs or a maximum of stages, non-negative
   costs, relative errors, and intervals for errors that the draws of a group share. Rows are arrays of numbers, one
   for each draw; `members` has a row for each stage: 1 for the terms that count in the stage, else 0. */

const BETWEEN_WEIGHT = 0.3, LARGE_ERROR = 0.05, MAX_FIT_RATIO = 2, FIT_TOLERANCE = 1e-4, MAX_ITERATIONS = 100;
const MIN_TIME_SHARE = 0.002, START_FACTORS = [1, 0.5, 2], MAX_REASSIGNMENTS = 40;

const dot = (p, q) => p.reduce((total, value, k) => total + value * q[k], 0);
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

/* Solve gram x = right for the columns `kept` by Cholesky factorisation; other and linearly dependent columns get 0. */
function solveColumns(gram, right, kept) {
  const factor = [], found = new Array(right.length).fill(0), y = [];
  for (const [i, row] of kept.entries()) {
    const line = (factor[i] = []);
    for (let j = 0; j <= i; j++) {
      let rest = gram[row][kept[j]];
      for (let k = 0; k < j; k++) rest -= line[k] * factor[j][k];
      line[j] = i > j ? (factor[j][j] ? rest / factor[j][j] : 0) : rest > 1e-12 * gram[row][row] ? Math.sqrt(rest) : 0;
    }
    let rest = right[row];
    for (let k = 0; k < i; k++) rest -= line[k] * y[k];
    y[i] = line[i] ? rest / line[i] : 0;
  }
  for (let i = kept.length - 1; i >= 0; i--) {
    let rest = y[i];
    for (let k = i + 1; k < kept.length; k++) rest -= factor[k][i] * found[kept[k]];
    found[kept[i]] = factor[i][i] ? rest / factor[i][i] : 0;
  }
  return found;
}

/* `solveColumns` with non-negative coefficients: C. Lawson and R. Hanson, "Solving Least Squares Problems", 1974, chapter 23. */
function solveNonNegative(gram, right) {
  const size = right.length, kept = [], barred = new Set();
  const tolerance = 1e-13 * Math.max(...right.map(Math.abs));
  let found = new Array(size).fill(0);
  for (;;) {
    const slopes = right.map((value, j) => (kept.includes(j) || barred.has(j) ? -Infinity : value - dot(gram[j], found)));
    const best = slopes.indexOf(Math.max(...slopes));
    if (!(slopes[best] > tolerance)) return found;
    kept.push(best);
    let next = solveColumns(gram, right, kept);
    // A column added only because of rounding errors is barred, as it would be added and removed for ever.
    if (next[best] <= 0) {
      barred.add(kept.pop());
      continue;
    }
    barred.clear();
    while (kept.some((j) => next[j] <= 0)) {
      const share = Math.min(...kept.filter((j) => next[j] <= 0).map((j) => found[j] / (found[j] - next[j])));
      found = found.map((value, j) => value + share * (next[j] - value));
      for (const j of kept.filter((each) => next[each] <= 0 && found[each] <= 1e-14 * Math.max(...found))) {
        kept.splice(kept.indexOf(j), 1);
        found[j] = 0;
      }
      next = solveColumns(gram, right, kept);
    }
    found = next;
  }
}

/* Gram matrix of the columns of flat rows, which are weighted by `trust`; the last column is the right-hand side. */
function computeGram(rows, width, trust) {
  const gram = range(width).map(() => new Array(width).fill(0));
  for (let start = 0, k = 0; start < rows.length; start += width, k++) {
    const weight = trust[k] * trust[k];
    for (let i = 0; i < width; i++) {
      const left = weight * rows[start + i];
      if (left) for (let j = i; j < width; j++) gram[i][j] += left * rows[start + j];
    }
  }
  for (let i = 0; i < width; i++) for (let j = 0; j < i; j++) gram[i][j] = gram[j][i];
  return gram;
}

/* Costs that fit the seconds of draws, by iteratively reweighted least squares of relative errors, non-negative unless `signed`;
   labels: each draw's group number. See harness/profile/cost_terms.py, fit_iteratively. */
function fitCoefficients(design, seconds, labels, signed = false) {
  const size = design[0].length, width = size + 1, groups = Math.max(...labels) + 1;
  const members = new Array(groups).fill(0);
  for (const label of labels) members[label]++;
  const rows = new Float64Array((design.length + groups) * width), trust = new Float64Array(design.length + groups).fill(1);
  let fitted = seconds, found = null;
  for (let turn = 0; turn < MAX_ITERATIONS; turn++) {
    rows.fill(0);
    design.forEach((row, k) => {
      const group = (design.length + labels[k]) * width, members_ = members[labels[k]];
      for (let j = 0; j < width; j++) {
        const share = (j < size ? row[j] : seconds[k]) / fitted[k];
        rows[k * width + j] = share;
        rows[group + j] += share / members_;
      }
    });
    design.forEach((_, k) => {
      for (let j = 0; j < width; j++) rows[k * width + j] -= rows[(design.length + labels[k]) * width + j];
    });
    members.forEach((number, label) => {
      for (let j = 0; j < width; j++) rows[(design.length + label) * width + j] *= BETWEEN_WEIGHT * Math.sqrt(number);
    });
    if (found?.some((value) => value !== 0)) {
      for (let k = 0; k < trust.length; k++) {
        let error = -rows[k * width + size];
        for (let j = 0; j < size; j++) error += rows[k * width + j] * found[j];
        trust[k] = (1 + (error / LARGE_ERROR) ** 2) ** -0.25;
      }
    }
    const whole = computeGram(rows, width, trust);
    const scale = range(size).map((j) => Math.sqrt(whole[j][j]) || 1);
    const gram = scale.map((own, i) => scale.map((other, j) => whole[i][j] / own / other));
    const right = scale.map((own, j) => whole[j][size] / own);
    const least = signed ? solveColumns(gram, right, range(size)) : solveNonNegative(gram, right);
    found = least.map((value, j) => value / scale[j]);
    const before = fitted;
    fitted = design.map((row, k) => clamp(dot(row, found), seconds[k] / MAX_FIT_RATIO, seconds[k] * MAX_FIT_RATIO));
    if (fitted.every((value, k) => Math.abs(value / before[k] - 1) <= FIT_TOLERANCE)) break;
  }
  return found;
}

const stageTimes = (row, costs, members) => members.map((member) => row.reduce((total, value, j) => total + value * costs[j] * member[j], 0));
const predictTime = (row, costs, members) => Math.max(...stageTimes(row, costs, members), 1e-12);
const indexOfMaximum = (values) => values.indexOf(Math.max(...values));
const keepBinding = (design, members, binding) => design.map((row, k) => row.map((value, j) => value * members[binding[k]][j]));

/* Sum of the soft L1 losses of relative errors, stacked as in the fit. */
function computeLoss(seconds, predicted, labels) {
  const errors = stackDeviations(seconds.map((value, k) => [value / predicted[k] - 1]), labels);
  return sum(errors.map(([error]) => Math.sqrt(1 + (error / LARGE_ERROR) ** 2) - 1));
}

/* Several initial assignments of draws to binding (slowest) stages; see harness/profile/law.py, yield_initial_stages. */
function makeStarts(design, seconds, members) {
  const shares = design.map((row, k) => row.map((value) => value / seconds[k]));
  const bounds = transpose(shares).map((column) => Math.max(...column) || 1);
  const nearness = shares.map((row) => members.map((member) => row.reduce((total, share, j) => total + (j ? (share / bounds[j]) * member[j] : 0), 0)));
  return members.flatMap((_, stage) => START_FACTORS.map((factor) =>
    nearness.map((row) => indexOfMaximum(row.map((value, s) => value * (s === stage ? factor : 1))))));
}

/* Fit a form: { costs, binding, loss }. Costs and each draw's binding stage are computed alternately until an assignment repeats; the
   assignment with the smallest loss is returned. */
function fitForm(design, seconds, labels, members, starts = makeStarts(design, seconds, members)) {
  const tried = new Set();
  let best = null;
  for (let binding of starts) {
    for (let turn = 0; turn < MAX_REASSIGNMENTS && !tried.has(binding.join()); turn++) {
      tried.add(binding.join());
      const costs = fitCoefficients(keepBinding(design, members, binding), seconds, labels);
      const loss = computeLoss(seconds, design.map((row) => predictTime(row, costs, members)), labels);
      binding = design.map((row) => indexOfMaximum(stageTimes(row, costs, members)));
      if (!best || loss < best.loss) best = { loss, costs, binding };
    }
  }
  return best;
}

/* Seconds of each draw, predicted by a fit to the other folds (cross-validation); draws of fold -1 are in every fit. */
function predictHeldOut(design, seconds, labels, folds, members, binding) {
  const predicted = new Array(seconds.length);
  for (const fold of new Set(folds)) {
    const fitted = range(seconds.length).filter((k) => fold < 0 || folds[k] !== fold);
    const pick = (values) => fitted.map((k) => values[k]);
    const { costs } = fitForm(pick(design), pick(seconds), rankDistinct(pick(labels)), members, [pick(binding)]);
    folds.forEach((own, k) => { if (own === fold) predicted[k] = predictTime(design[k], costs, members); });
  }
  return predicted;
}

/* Mean absolute error of log time in each fold, except fold -1, whose draws are in every fit. */
const computeFoldErrors = (seconds, predicted, folds) => range(Math.max(...folds) + 1).map((fold) =>
  mean(range(folds.length).filter((k) => folds[k] === fold).map((k) => Math.abs(Math.log(predicted[k] / seconds[k])))));

/* The form to use: a form with more stages only if its errors are smaller by more than `least` standard errors (default 1). */
function chooseForm(errors, least) {
  const [first, ...others] = Object.keys(errors);
  return others.reduce((chosen, name) => {
    const smaller = errors[chosen].map((error, fold) => error - errors[name][fold]), middle = mean(smaller);
    const deviation = Math.sqrt(sum(smaller.map((value) => (value - middle) ** 2)) / (smaller.length - 1));
    return middle > ((least[name] ?? 1) * deviation) / Math.sqrt(smaller.length) ? name : chosen;
  }, first);
}

/* The rank, from 0, of each value among the distinct sorted values. */
function rankDistinct(values) {
  const places = new Map([...new Set(values)].sort((p, q) => (p < q ? -1 : 1)).map((value, k) => [value, k]));
  return values.map((value) => places.get(value));
}

function subtractGroupMeans(values, labels) {
  const means = range(Math.max(...labels) + 1).map((label) => mean(values.filter((_, k) => labels[k] === label)));
  return values.map((value, k) => value - means[labels[k]]);
}

/* [over all, within groups]: the share of the variance of log time that a prediction explains. */
function explainedVariance(seconds, predicted, labels) {
  const logs = [seconds, predicted].map((values) => values.map(Math.log));
  const squares = (values) => dot(values, values);
  const share = ([p, q]) => 1 - squares(p.map((value, k) => value - q[k])) / squares(p);
  const middle = mean(logs[0]);
  return [share(logs.map((values) => values.map((value) => value - middle))), share(logs.map((values) => subtractGroupMeans(values, labels)))];
}

const product = (left, right) => left.map((row) => right[0].map((_, j) => row.reduce((total, value, k) => total + value * right[k][j], 0)));
const transpose = (rows) => rows[0].map((_, j) => rows.map((row) => row[j]));

/* Rows minus the mean of the row's group, then a weighted row of each group's mean; see cost_terms.py, stack_deviations. */
function stackDeviations(rows, labels) {
  const groups = range(Math.max(...labels) + 1).map((label) => rows.filter((_, k) => labels[k] === label));
  const means = groups.map((own) => own[0].map((_, j) => mean(own.map((row) => row[j]))));
  return [...rows.map((row, k) => row.map((value, j) => value - means[labels[k]][j])),
    ...means.map((row, label) => row.map((value) => BETWEEN_WEIGHT * Math.sqrt(groups[label].length) * value))];
}

/* Signed costs (`free`), which of them the draws determine (`known`), and their covariance under errors of single draws and
   errors that a group's draws share; see harness/profile/law.py, _estimate_covariance. */
function estimateCovariance(design, seconds, labels) {
  const size = design[0].length, free = fitCoefficients(design, seconds, labels, true);
  const fitted = design.map((row, k) => clamp(dot(row, free), seconds[k] / MAX_FIT_RATIO, seconds[k] * MAX_FIT_RATIO));
  const shares = design.map((row, k) => row.map((value) => value / fitted[k]));
  const rows = stackDeviations(shares.map((row, k) => [...row, seconds[k] / fitted[k]]), labels);
  const trust = rows.map((row) => (1 + ((dot(row.slice(0, size), free) - row[size]) / LARGE_ERROR) ** 2) ** -0.25);
  const scale = range(size).map((j) => Math.sqrt(sum(rows.map((row, k) => (row[j] * trust[k]) ** 2))) || 1);
  const even = rows.map((row, k) => range(size).map((j) => (trust[k] * row[j]) / scale[j]));
  const gram = product(transpose(even), even), unit = stackDeviations(design.map((_, k) => design.map((__, j) => Number(j === k))), labels);
  const right = product(transpose(even), unit.map((row, k) => row.map((value) => trust[k] * value)));
  const moved = transpose(transpose(right).map((column) => solveColumns(gram, column, range(size)).map((value, j) => value / scale[j])));
  const errors = seconds.map((value, k) => value / fitted[k] - dot(shares[k], free));
  const followed = product(shares, moved), left = followed.map((row, i) => row.map((value, j) => Number(i === j) - value));
  // The effect of an error that a group's draws share is the sum of the group's columns.
  const grouped = (matrix) => matrix.map((row) => range(Math.max(...labels) + 1).map((label) => sum(row.filter((_, k) => labels[k] === label))));
  // Sums of squares within groups, and of the group means.
  const squares = (column) => {
    const apart = subtractGroupMeans(column, labels), within = dot(apart, apart);
    return [within, dot(column, column) - within];
  };
  const expected = [left, grouped(left)].map((matrix) => transpose(matrix).map(squares).reduce(([p, q], [r, s]) => [p + r, q + s], [0, 0]));
  const estimate = squares(errors), [[a, c], [b, d]] = expected, whole = a * d - b * c;
  let own = (estimate[0] * d - estimate[1] * b) / whole, shared = (estimate[1] * a - estimate[0] * c) / whole;
  if (Math.min(own, shared) < 0) [own, shared] = [(estimate[0] + estimate[1]) / (a + c), 0];
  const square = (matrix) => product(matrix, transpose(matrix)), [one, other] = [moved, grouped(moved)].map(square);
  // A coefficient is determined unless the other columns reproduce its column.
  const known = gram.map((column, j) => gram[j][j] - dot(column, solveColumns(gram, column, range(size).filter((k) => k !== j))) > 1e-9);
  return { free, known, covariance: one.map((row, i) => row.map((value, j) => own * value + shared * other[i][j])) };
}

/* The law fitted to counters (draws, terms) and seconds (epochs, draws); forms: the members of each form, simplest first. */
function fitLaw(design, epochs, { labels, folds, reach, standard_errors: least }, forms) {
  const logs = epochs.map((row) => row.map(Math.log));
  const seconds = design.map((_, k) => Math.exp(mean(logs.map((row) => row[k]))));
  const fits = mapValues(forms, (members) => fitForm(design, seconds, labels, members));
  const predicted = mapValues(forms, (members, name) => predictHeldOut(design, seconds, labels, folds, members, fits[name].binding));
  const errors = mapValues(predicted, (times) => computeFoldErrors(seconds, times, folds));
  const form = chooseForm(errors, least), members = forms[form], { costs, binding } = fits[form];
  const masked = keepBinding(design, members, binding), { free, known, covariance } = estimateCovariance(masked, seconds, labels);
  const largest = (rows) => transpose(rows.map((row, k) => row.map((value) => value / seconds[k]))).map((column) => Math.max(...column));
  const bounds = largest(design).map((share) => 1 / Math.max(share, 1e-12)), shares = largest(masked);
  const isKnown = known.map((value, j) => value || !members.some((member) => member[j]));
  const ends = (quantile) => costs.map((cost, j) => {
    const width = quantile * Math.sqrt(covariance[j][j]);
    return isKnown[j] ? [Math.max(0, Math.min(cost, free[j] - width)), Math.max(cost, free[j] + width)] : [0, bounds[j]];
  });
  const [low, high] = transpose(ends(reach[0])), [r2_over, r2_within] = explainedVariance(seconds, predicted[form], labels);
  return { form, seconds: costs, low, high, shown: ends(reach[1]).map(([end], j) => end * shares[j] > MIN_TIME_SHARE), known: isKnown,
    binding, errors: mapValues(errors, mean), r2_over, r2_within };
}

const mapValues = (object, change) => Object.fromEntries(Object.entries(object).map(([name, value]) => [name, change(value, name)]));
