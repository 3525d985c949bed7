/* A simulated GPU with known costs and exact counters; only drawing advances the clock. */
function makeWorld({ costs, noise = 0.002, scale = 1, slower = () => 1, timer = false, wrong = -1, describe = "a test's GPU", at = {} }) {
  let now = 0, drawn = 0, seed = 1, place = 0, lose;
  const random = () => { seed = (seed * 16807) % 2147483647; return seed / 2147483647; };
  Math.random = random;
  const known = new WeakMap(), { page } = state;
  timing.clock = () => { now += 1e-8; return now; };
  const lost = new Promise((done) => { lose = () => done({ message: "it was unplugged" }); });
  openDevice = async () => ({ device: { limits: { maxTextureDimension2D: 8192 }, lost, addEventListener() {}, destroy() {} },
    info: { vendor: "test", architecture: "", device: "", description: describe, timer, step: null, fallback: false,
      limits: { maxTextureDimension2D: 8192, maxBufferSize: 1, maxStorageBufferBindingSize: 1 } } });
  findStep = async () => 1;
  const drawing = (seconds) => ({ close() {}, sample: async (repeats) => {
    await at[++drawn]?.({ lose });
    const taken = seconds * scale * slower(drawn) * repeats * (1 + noise * (random() - 0.5));
    now += taken;
    return { wall: taken, gpu: timer ? taken : null };
  } });
  layers = (_, size, number) => drawing(1e-3 * number);
  Painter = class {
    constructor(device) { this.device = device; }
    async count(frame) {
      const k = place++, { counters } = page.grids[1];
      const found = { ...Object.fromEntries(Object.entries(counters).map(([name, values]) => [name, values[k]])), draw: 1 };
      known.set(frame, sum(Object.entries(costs).map(([name, cost]) => (cost * found[name]) / (page.in_px.includes(name) ? 256 : 1))));
      return { fragments: [found.fragments + Number(k === wrong)], quads: [found.quads] };
    }
    prepare(frame, rows) { return drawing(rows.length ? known.get(frame) : costs.draw); }
  };
}

/* Hide the page and show it again a moment later. */
function hide() {
  Object.defineProperty(document, "hidden", { get: () => hide.now, configurable: true });
  const turn = (to) => { hide.now = to; document.dispatchEvent(new Event("visibilitychange")); };
  turn(true);
  setTimeout(() => { hide.said = $("notice").textContent; turn(false); }, 30);
}

/* Fit the law to given times. */
async function fitAs({ epochs }) {
  const { places } = state.page.fitted, { page } = state;
  const rows = makeDesignRows(state.page, state.page.grids[1].counters, state.page.draws.length);
  const pick = (values) => places.map((k) => values[k]);
  return { ...fitLaw(pick(rows), epochs.map(pick), page.fitted, listMembers(page)), rows };
}

const sumsOf = (made, step) => made.map(({ points, rows }) => computeChecksum({ points: snapPoints(points, step), rows }));

/* Counters of some draws on the browser's GPU minus the expected ones: fragments, quads, fragments, ... */
async function differencesOf(places) {
  const { device, info } = await openDevice(), painter = new Painter(device, info, state.page.shaders);
  const step = await findStep(painter), { counters } = state.page.grids[step], made = makeDesign(state.page.seed);
  const found = [];
  for (const k of places) {
    const points = Int32Array.from(snapPoints(made[k].points, step));
    const frame = { size: SIDE, points, owner: new Uint32Array(points.length / 2), polygons: 1, work: 0 };
    const { fragments, quads } = await painter.count(frame, Uint32Array.from(made[k].rows));
    found.push(fragments[0] - counters.fragments[k], quads[0] - counters.quads[k]);
  }
  return found;
}
