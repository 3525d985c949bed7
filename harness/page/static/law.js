"use strict";
/* A device's law, as harness/profile/law.py and fitting.py fit it: coefficients that are not negative, relative
   errors, intervals under errors that the draws of a group share. Rows are arrays of numbers, one a draw. */

const BETWEEN = 0.3, LARGE_ERROR = 0.05, FAR_OFF = 2, CLOSE = 1e-4, MOST_TURNS = 100;
const SHARE = 0.002;

const dot = (p, q) => p.reduce((total, value, k) => total + value * q[k], 0);
const between = (value, low, high) => Math.min(Math.max(value, low), high);

/* Solve the columns `kept` of the equations gram x = right, by Cholesky's factors; what depends on others gets 0. */
function solved(gram, right, kept) {
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

/* The same, with nothing negative: C. Lawson and R. Hanson, "Solving Least Squares Problems", 1974, chapter 23. */
function solvedAbove(gram, right) {
  const size = right.length, kept = [], barred = new Set();
  const tolerance = 1e-13 * Math.max(...right.map(Math.abs));
  let found = new Array(size).fill(0);
  for (;;) {
    const slopes = right.map((value, j) => (kept.includes(j) || barred.has(j) ? -Infinity : value - dot(gram[j], found)));
    const best = slopes.indexOf(Math.max(...slopes));
    if (!(slopes[best] > tolerance)) return found;
    kept.push(best);
    let next = solved(gram, right, kept);
    // What only rounding lets in would come and go for ever.
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
      next = solved(gram, right, kept);
    }
    found = next;
  }
}

/* Sums of products of the columns of flat rows, each weighted; the last column is the right-hand side. */
function gramOf(rows, width, trust) {
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

/* Coefficients of the columns of `design`; labels: a number for each draw, equal in a group. See fitting.solve. */
function coefficientsOf(design, seconds, labels, signed = false) {
  const size = design[0].length, width = size + 1, groups = Math.max(...labels) + 1;
  const members = new Array(groups).fill(0);
  for (const label of labels) members[label]++;
  const rows = new Float64Array((design.length + groups) * width), trust = new Float64Array(design.length + groups).fill(1);
  let fitted = seconds, found = null;
  for (let turn = 0; turn < MOST_TURNS; turn++) {
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
      for (let j = 0; j < width; j++) rows[(design.length + label) * width + j] *= BETWEEN * Math.sqrt(number);
    });
    if (found?.some((value) => value !== 0)) {
      for (let k = 0; k < trust.length; k++) {
        let error = -rows[k * width + size];
        for (let j = 0; j < size; j++) error += rows[k * width + j] * found[j];
        trust[k] = (1 + (error / LARGE_ERROR) ** 2) ** -0.25;
      }
    }
    const whole = gramOf(rows, width, trust);
    const scale = range(size).map((j) => Math.sqrt(whole[j][j]) || 1);
    const gram = scale.map((own, i) => scale.map((other, j) => whole[i][j] / own / other));
    const right = scale.map((own, j) => whole[j][size] / own);
    const least = signed ? solved(gram, right, range(size)) : solvedAbove(gram, right);
    found = least.map((value, j) => value / scale[j]);
    const before = fitted;
    fitted = design.map((row, k) => between(dot(row, found), seconds[k] / FAR_OFF, seconds[k] * FAR_OFF));
    if (fitted.every((value, k) => Math.abs(value / before[k] - 1) <= CLOSE)) break;
  }
  return found;
}

/* Seconds of each draw, predicted by a fit to the draws of other folds than its own. */
function heldOut(design, seconds, labels, folds) {
  const predicted = new Array(seconds.length);
  for (const fold of new Set(folds)) {
    const fittedOn = range(seconds.length).filter((k) => folds[k] !== fold);
    const pick = (values) => fittedOn.map((k) => values[k]);
    // Labels that no draw has are groups of nothing.
    const found = coefficientsOf(pick(design), pick(seconds), numbered(pick(labels)));
    folds.forEach((own, k) => { if (own === fold) predicted[k] = Math.max(dot(design[k], found), 1e-12); });
  }
  return predicted;
}

/* A number from 0 on for each different value, in the order of the values. */
function numbered(values) {
  const places = new Map([...new Set(values)].sort((p, q) => (p < q ? -1 : 1)).map((value, k) => [value, k]));
  return values.map((value) => places.get(value));
}

function centred(values, labels) {
  const means = range(Math.max(...labels) + 1).map((label) => mean(values.filter((_, k) => labels[k] === label)));
  return values.map((value, k) => value - means[labels[k]]);
}

/* [over all, within groups]: the share of the variance of log time that a prediction explains. */
function explained(seconds, predicted, labels) {
  const logs = [seconds, predicted].map((values) => values.map(Math.log));
  const squares = (values) => dot(values, values);
  const share = ([p, q]) => 1 - squares(p.map((value, k) => value - q[k])) / squares(p);
  const middle = mean(logs[0]);
  return [share(logs.map((values) => values.map((value) => value - middle))), share(logs.map((values) => centred(values, labels)))];
}

const product = (left, right) => left.map((row) => right[0].map((_, j) => row.reduce((total, value, k) => total + value * right[k][j], 0)));
const transposed = (rows) => rows[0].map((_, j) => rows.map((row) => row[j]));

/* Deviations from their group's mean, and below these the means, weighed: fitting.stacked. */
function stacked(rows, labels) {
  const groups = range(Math.max(...labels) + 1).map((label) => rows.filter((_, k) => labels[k] === label));
  const means = groups.map((own) => own[0].map((_, j) => mean(own.map((row) => row[j]))));
  return [...rows.map((row, k) => row.map((value, j) => value - means[labels[k]][j])),
    ...means.map((row, label) => row.map((value) => BETWEEN * Math.sqrt(groups[label].length) * value))];
}

/* Signed coefficients and their covariance under errors that groups share: law._covariance. */
function covarianceOf(design, seconds, labels) {
  const size = design[0].length, free = coefficientsOf(design, seconds, labels, true);
  const fitted = design.map((row, k) => between(dot(row, free), seconds[k] / FAR_OFF, seconds[k] * FAR_OFF));
  const shares = design.map((row, k) => row.map((value) => value / fitted[k]));
  const rows = stacked(shares.map((row, k) => [...row, seconds[k] / fitted[k]]), labels);
  const trust = rows.map((row) => (1 + ((dot(row.slice(0, size), free) - row[size]) / LARGE_ERROR) ** 2) ** -0.25);
  const scale = range(size).map((j) => Math.sqrt(sum(rows.map((row, k) => (row[j] * trust[k]) ** 2))) || 1);
  const even = rows.map((row, k) => range(size).map((j) => (trust[k] * row[j]) / scale[j]));
  const gram = product(transposed(even), even), unit = stacked(design.map((_, k) => design.map((__, j) => Number(j === k))), labels);
  const right = product(transposed(even), unit.map((row, k) => row.map((value) => trust[k] * value)));
  const moved = transposed(transposed(right).map((column) => solved(gram, column, range(size)).map((value, j) => value / scale[j])));
  const errors = seconds.map((value, k) => value / fitted[k] - dot(shares[k], free));
  const followed = product(shares, moved), left = followed.map((row, i) => row.map((value, j) => Number(i === j) - value));
  // Sums of a group's columns: what an error that a group shares does.
  const grouped = (matrix) => matrix.map((row) => range(Math.max(...labels) + 1).map((label) => sum(row.filter((_, k) => labels[k] === label))));
  // Squares within groups, and of their means.
  const squares = (column) => {
    const apart = centred(column, labels), within = dot(apart, apart);
    return [within, dot(column, column) - within];
  };
  const expected = [left, grouped(left)].map((matrix) => transposed(matrix).map(squares).reduce(([p, q], [r, s]) => [p + r, q + s], [0, 0]));
  const estimate = squares(errors), [[a, c], [b, d]] = expected, whole = a * d - b * c;
  let own = (estimate[0] * d - estimate[1] * b) / whole, shared = (estimate[1] * a - estimate[0] * c) / whole;
  if (Math.min(own, shared) < 0) [own, shared] = [(estimate[0] + estimate[1]) / (a + c), 0];
  const square = (matrix) => product(matrix, transposed(matrix)), [one, other] = [moved, grouped(moved)].map(square);
  return { free, covariance: one.map((row, i) => row.map((value, j) => own * value + shared * other[i][j])) };
}

/* The law of (draws, terms) rows and seconds of each epoch: {seconds, low, high, shown, sums, r2_over, r2_within}. */
function lawOf(design, epochs, { labels, folds, reach }, together = {}) {
  const logs = epochs.map((row) => row.map(Math.log));
  const seconds = design.map((_, k) => Math.exp(mean(logs.map((row) => row[k]))));
  const terms = range(design[0].length), found = coefficientsOf(design, seconds, labels);
  const { free, covariance } = covarianceOf(design, seconds, labels);
  const ends = (weights, errors) => {
    const width = errors * Math.sqrt(dot(weights, covariance.map((row) => dot(row, weights)))), value = dot(weights, found), middle = dot(weights, free);
    return [Math.max(0, Math.min(value, middle - width)), Math.max(value, middle + width)];
  };
  const estimate = (weights) => {
    const paid = terms.filter((j) => weights[j] > 0), [low, high] = ends(weights, reach[0]);
    const most = Math.max(...design.map((row, k) => Math.min(...paid.map((j) => row[j] / weights[j])) / seconds[k]));
    return { seconds: dot(weights, found), low, high, shown: ends(weights, reach[1])[0] * most > SHARE };
  };
  const each = terms.map((j) => estimate(terms.map((k) => Number(j === k))));
  const [r2_over, r2_within] = explained(seconds, heldOut(design, seconds, labels, folds), labels);
  return { seconds: found, ...Object.fromEntries(["low", "high", "shown"].map((name) => [name, each.map((one) => one[name])])),
    sums: Object.entries(together).map(([name, { weights, words }]) => ({ name, words, ...estimate(weights) })), r2_over, r2_within };
}

/* Places of the fewest terms that predict as well as all: left out one by one, judged in standard errors. */
async function fewestOf(design, seconds, labels, folds, rest = () => {}) {
  const judged = (columns) => heldOut(design.map((row) => columns.map((j) => row[j])), seconds, labels, folds)
    .map((predicted, k) => Math.log(seconds[k] / predicted) ** 2);
  let kept = range(design[0].length);
  const way = [{ kept, errors: judged(kept) }];
  while (kept.length > 1) {
    const fewer = kept.slice(1).map((left) => {
      const columns = kept.filter((column) => column !== left);
      return { kept: columns, errors: judged(columns) };
    });
    const means = fewer.map((each) => mean(each.errors));
    way.push(fewer[means.indexOf(Math.min(...means))]);
    kept = way.at(-1).kept;
    await rest(1 - kept.length / design[0].length);
  }
  const means = way.map((each) => mean(each.errors)), best = means.indexOf(Math.min(...means));
  const { errors } = way[best];
  const error = Math.sqrt(sum(errors.map((value) => (value - means[best]) ** 2)) / (errors.length - 1) / errors.length);
  return way[means.findLastIndex((value) => value - means[best] <= Math.max(error, 1e-12))].kept;
}
