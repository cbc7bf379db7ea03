"use strict";
/* Maps of a run: packed arrays become heights in um, droplets and errors. Index of cell (i, j): i * ny + j. */

const ARRAYS = { int8: Int8Array, int16: Int16Array, int32: Int32Array, float32: Float32Array };

/* A packed array: base64 of deflated little-endian numbers. */
async function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new ARRAYS[packed.type](await new Response(stream).arrayBuffer());
}

/* One run. A page that is open while the run is printed gets further layers by `add`. */
class Run {
  constructor(description) {
    this.name = description.name;
    this.grid = description.grid;
    this.block = description.block;
    [this.nx, this.ny] = description.shape;
    this.pitch = description.pitch_mm;
    this.step = description.step_um;
    this.inks = description.inks;
    this.steps = [];
    this.jetted = [];
  }

  async add(description) {
    const { first, heights, droplets } = description.layers;
    const size = this.nx * this.ny;
    [this.target, this.part] = await Promise.all([unpack(description.target), unpack(description.part)]);
    const [differences, jetted] = await Promise.all([unpack(heights), unpack(droplets)]);
    this.steps.length = this.jetted.length = first;
    let before = first > 0 ? this.steps[first - 1] : new Int32Array(size);
    for (let start = 0; start < differences.length; start += size) {
      const layer = Int32Array.from(before);
      for (let cell = 0; cell < size; cell++) layer[cell] += differences[start + cell];
      this.steps.push(layer);
      this.jetted.push(jetted.subarray(start, start + size));
      before = layer;
    }
    const final = description.final;
    const [part, errors] = await Promise.all([unpack(final.part), unpack(final.errors)]);
    const um = Float64Array.from(errors, (error, cell) => (part[cell] ? error * this.step : NaN));
    this.final = { block: final.block, nx: final.shape[0], ny: final.shape[1], errors: um };
  }

  get layers() {
    return this.steps.length;
  }

  heights(layer) {
    return Float64Array.from(this.steps[layer], (step) => step * this.step);
  }

  /* Target minus height over the part, NaN elsewhere. */
  errors(layer) {
    const steps = this.steps[layer];
    return Float64Array.from(steps, (step, cell) => (this.part[cell] ? this.target[cell] - step * this.step : NaN));
  }
}

/* Edges of blocks along an axis of so many cells [mm]; the centre of cell 0 is at 0. */
function edges(cells, block, pitch) {
  const count = Math.ceil(cells / block);
  return Array.from({ length: count + 1 }, (_, k) => (Math.min(k * block, cells) - 0.5) * pitch);
}

/* Middles of blocks along an axis [mm]. */
function middles(cells, block, pitch) {
  const sides = edges(cells, block, pitch);
  return sides.slice(1).map((side, k) => (side + sides[k]) / 2);
}

/* Rows along x, one for each place along y, as Plotly draws maps. */
function rows(values, nx, ny) {
  return Array.from({ length: ny }, (_, j) => Float64Array.from({ length: nx }, (_, i) => values[i * ny + j]));
}

/* The value below which a share of the numbers lies; NaN are left out. */
function quantile(values, share) {
  const sorted = values.filter((value) => !Number.isNaN(value)).sort();
  return sorted.length ? sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] : 0;
}
