"use strict";
/* The browser's GPU: exact counts of fragments, quads and partial quads, and repeated draws for timing. */

const FORMAT = "rgba8unorm";
const KEEP_ALPHA = 7, WRITE_ALL = 15;
const IMMEDIATE = ["nvidia", "amd", "intel"];
const LIMITS = ["maxTextureDimension2D", "maxBufferSize", "maxStorageBufferBindingSize"];
const MAX_BATCH_LANES = 2 ** 30;
const SELF_TEST_PX = 1024;

const BROWSERS = "WebGPU is in Chrome and Edge from 113 (Android: 121), in Safari from 26, and in Firefox from 141 on "
  + "Windows and 145 on Macs with Apple's chips. On Linux, Chrome may need chrome://flags/#enable-unsafe-webgpu.";

/* Return { device, info }; throw an Error with a message for the user if WebGPU is unavailable. */
async function openDevice() {
  if (!navigator.gpu) throw new Error(`This browser has no WebGPU. ${BROWSERS}`);
  const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
  if (!adapter) throw new Error(`This browser has WebGPU but finds no GPU that it may use. ${BROWSERS}`);
  const hasTimer = adapter.features.has("timestamp-query");
  const device = await adapter.requestDevice({
    requiredFeatures: hasTimer ? ["timestamp-query"] : [],
    requiredLimits: Object.fromEntries(LIMITS.map((name) => [name, adapter.limits[name]])),
  });
  const gpuInfo = adapter.info ?? {};
  const info = Object.fromEntries(["vendor", "architecture", "device", "description"].map((name) => [name, gpuInfo[name] ?? ""]));
  return { device, info: { ...info, timer: hasTimer, step: null, fallback: Boolean(gpuInfo.isFallbackAdapter ?? adapter.isFallbackAdapter),
    limits: Object.fromEntries(LIMITS.map((name) => [name, adapter.limits[name]])) } };
}

/* Draws and counts triangulations. A frame has points (n, 2) in 1/256 px and the polygon of each point (owner); rows (m, 3)
   are the vertex indices of triangles. */
class Painter {
  constructor(device, info, shaders) {
    this.device = device;
    this.instances = IMMEDIATE.some((vendor) => info.vendor.toLowerCase().includes(vendor));
    this.hasTimer = info.timer;
    const attribute = (format, offset, shaderLocation) => ({ format, offset, shaderLocation });
    this.draw = this.pipeline(shaders.draw, "shade", WRITE_ALL, [
      { arrayStride: 8, attributes: [attribute("sint32x2", 0, 0)] },
      { arrayStride: 4, attributes: [attribute("uint32", 0, 1)] },
    ]);
    this.tally = this.pipeline(shaders.count, "count", KEEP_ALPHA, [
      { arrayStride: 28, stepMode: "instance",
        attributes: [attribute("sint32x4", 0, 0), attribute("sint32x2", 16, 1), attribute("uint32", 24, 2)] },
    ]);
    this.targets = new Map();
  }

  pipeline(code, entryPoint, writeMask, buffers) {
    const module = this.device.createShaderModule({ code });
    return this.device.createRenderPipeline({
      layout: "auto",
      vertex: { module, entryPoint: "place", buffers },
      primitive: { topology: "triangle-list" },
      fragment: { module, entryPoint, targets: [{ format: FORMAT, writeMask }] },
    });
  }

  buffer(content, usage) {
    const size = Math.max(4, Math.ceil(content.byteLength / 4) * 4);
    const made = this.device.createBuffer({ size, usage: usage | GPUBufferUsage.COPY_DST });
    if (content.byteLength) this.device.queue.writeBuffer(made, 0, content);
    return made;
  }

  target(size) {
    if (!this.targets.has(size)) {
      const texture = this.device.createTexture({ size: [size, size], format: FORMAT, usage: GPUTextureUsage.RENDER_ATTACHMENT });
      this.targets.set(size, texture.createView());
    }
    return this.targets.get(size);
  }

  group(pipeline, ...buffers) {
    const entries = buffers.map((buffer, binding) => ({ binding, resource: { buffer } }));
    return this.device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries });
  }

  pass(encoder, size, timestampWrites) {
    const attachment = { view: this.target(size), loadOp: "load", storeOp: "store" };
    return encoder.beginRenderPass({ colorAttachments: [attachment], ...(timestampWrites ? { timestampWrites } : {}) });
  }

  async read(source, size) {
    const copy = this.device.createBuffer({ size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const encoder = this.device.createCommandEncoder();
    encoder.copyBufferToBuffer(source, 0, copy, 0, size);
    this.device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const content = copy.getMappedRange().slice(0);
    copy.destroy();
    return content;
  }

  /* Count each polygon's fragments, quads, partial quads and covering triangles; the counters of one draw stay below 3 * 2^30. */
  async count(frame, rows) {
    const [fragments, quads, full, covering_triangles] = [0, 1, 2, 3].map(() => new Array(frame.polygons).fill(0));
    for (const [first, last] of batches(frame, rows)) {
      const counts = await this.countRange(frame, rows, first, last);
      for (let k = 0; k < frame.polygons; k++) {
        fragments[k] += counts[4 * k];
        quads[k] += counts[4 * k + 1] / 12;
        full[k] += counts[4 * k + 2] / 4;
        covering_triangles[k] += counts[4 * k + 3];
      }
    }
    const partial_quads = quads.map((value, k) => Math.round(value) - Math.round(full[k]));
    return { fragments, quads: quads.map(Math.round), partial_quads, covering_triangles };
  }

  async countRange(frame, rows, first, last) {
    const triangles = new Int32Array(7 * (last - first));
    for (let t = first; t < last; t++) {
      for (let corner = 0; corner < 3; corner++) {
        const vertex = rows[3 * t + corner];
        triangles[7 * (t - first) + 2 * corner] = frame.points[2 * vertex];
        triangles[7 * (t - first) + 2 * corner + 1] = frame.points[2 * vertex + 1];
      }
      triangles[7 * (t - first) + 6] = frame.owner[rows[3 * t]];
    }
    const bytes = 16 * frame.polygons;
    const counts = this.buffer(new Uint32Array(4 * frame.polygons), GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC);
    const size = this.buffer(new Float32Array([256 * frame.size, 256 * frame.size]), GPUBufferUsage.UNIFORM);
    const covering = this.buffer(new Uint32Array(((last - first) >> 5) + 1), GPUBufferUsage.STORAGE);
    const drawn = this.buffer(triangles, GPUBufferUsage.VERTEX);
    const encoder = this.device.createCommandEncoder();
    const pass = this.pass(encoder, frame.size);
    pass.setPipeline(this.tally);
    pass.setBindGroup(0, this.group(this.tally, size, counts, covering));
    pass.setVertexBuffer(0, drawn);
    pass.draw(3, last - first);
    pass.end();
    this.device.queue.submit([encoder.finish()]);
    const found = new Uint32Array(await this.read(counts, bytes));
    for (const buffer of [counts, covering, size, drawn]) buffer.destroy();
    return found;
  }

  prepare(frame, rows) {
    return new Drawing(this, frame, rows);
  }
}

/* Ranges [first, last + 1] of triangles whose lane counts fit into 32 bits. */
function batches(frame, rows) {
  const ranges = [];
  let first = 0, lanes = 0;
  for (let t = 0; t < rows.length / 3; t++) {
    const side = (axis) => {
      const at = [0, 1, 2].map((corner) => frame.points[2 * rows[3 * t + corner] + axis]);
      return Math.floor((Math.max(...at) - Math.min(...at)) / 256) + 4;
    };
    const more = side(0) * side(1);
    if (lanes + more >= MAX_BATCH_LANES) {
      ranges.push([first, t]);
      [first, lanes] = [t, 0];
    }
    lanes += more;
  }
  ranges.push([first, rows.length / 3]);
  return ranges;
}

class Drawing {
  constructor(painter, frame, rows) {
    this.painter = painter;
    this.size = frame.size;
    this.indices = rows.length;
    const view = new ArrayBuffer(16);
    new Float32Array(view).set([256 * frame.size, 256 * frame.size]);
    new Uint32Array(view)[2] = frame.work ?? 0;
    this.buffers = [
      painter.buffer(frame.points, GPUBufferUsage.VERTEX),
      painter.buffer(frame.owner, GPUBufferUsage.VERTEX),
      painter.buffer(rows, GPUBufferUsage.INDEX),
      painter.buffer(new Uint8Array(view), GPUBufferUsage.UNIFORM),
    ];
    this.group = painter.group(painter.draw, this.buffers[3]);
    if (painter.hasTimer) {
      this.queries = painter.device.createQuerySet({ type: "timestamp", count: 2 });
      this.answers = painter.device.createBuffer({ size: 16, usage: GPUBufferUsage.QUERY_RESOLVE | GPUBufferUsage.COPY_SRC });
    }
  }

  /* Immediate-mode GPUs draw the repeats as instances of one draw. Tile-based GPUs would omit fragments that a later
     triangle of the same pass hides, so on these each repeat has a pass. */
  async sample(repeats) {
    const { device, instances, hasTimer } = this.painter;
    const passes = instances ? 1 : repeats;
    const commands = [];
    for (let k = 0; k < passes; k++) commands.push(this.encode(instances ? repeats : 1, k === 0, k === passes - 1));
    const start = timing.clock();
    device.queue.submit(commands);
    await device.queue.onSubmittedWorkDone();
    const wall = timing.clock() - start;
    if (!hasTimer) return { wall, gpu: null };
    const [begin, end] = new BigUint64Array(await this.painter.read(this.answers, 16));
    return { wall, gpu: end > begin ? Number(end - begin) * 1e-9 : 0 };
  }

  encode(instances, first, last) {
    const encoder = this.painter.device.createCommandEncoder();
    const stamps = this.painter.hasTimer && (first || last) ? { querySet: this.queries,
      ...(first ? { beginningOfPassWriteIndex: 0 } : {}), ...(last ? { endOfPassWriteIndex: 1 } : {}) } : null;
    const pass = this.painter.pass(encoder, this.size, stamps);
    pass.setPipeline(this.painter.draw);
    pass.setBindGroup(0, this.group);
    pass.setVertexBuffer(0, this.buffers[0]);
    pass.setVertexBuffer(1, this.buffers[1]);
    pass.setIndexBuffer(this.buffers[2], "uint32");
    // An empty drawing is a pass without a draw call, because browsers warn of draws without triangles.
    if (this.indices) pass.drawIndexed(this.indices, instances);
    pass.end();
    if (stamps && last) encoder.resolveQuerySet(this.queries, 0, 2, this.answers, 0);
    return encoder.finish();
  }

  close() {
    for (const buffer of this.buffers) buffer.destroy();
    if (this.queries) {
      this.queries.destroy();
      this.answers.destroy();
    }
  }
}

/* A drawing that fills a square viewport `number` times, for the timer test. */
function layers(painter, size, number) {
  const far = 256 * size;
  const points = new Int32Array([0, 0, far, 0, far, far, 0, far]);
  const rows = new Uint32Array(6 * number);
  for (let k = 0; k < number; k++) rows.set([0, 1, 2, 0, 2, 3], 6 * k);
  return painter.prepare({ size, points, owner: new Uint32Array(4), polygons: 1 }, rows);
}
