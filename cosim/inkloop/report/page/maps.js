"use strict";
/* Maps of a run: packed arrays become heights in um, droplets and errors. Index of cell (i, j): j * nx + i. */

const ARRAYS = { int8: Int8Array, int16: Int16Array, int32: Int32Array, float32: Float32Array };

/* A packed array: base64 of deflated little-endian numbers. */
async function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new ARRAYS[packed.type](await new Response(stream).arrayBuffer());
}

/* One run. A page that is open while the run is printed gets further layers by `add`. */
class Run {
  steps = [];
  jetted = [];
  planned = [];

  async add({ layers, final, target, part, ...described }) {
    const arrays = [layers.heights, layers.droplets, target, part, final.errors, final.part, ...(layers.planned ? [layers.planned] : [])];
    const [differences, jetted, targets, isPart, errors, isFinalPart, planned] = await Promise.all(arrays.map(unpack));
    Object.assign(this, described, { target: targets, part: isPart, finalEdges: final.edges });
    [this.nx, this.ny] = this.edges.map((edges) => edges.length - 1);
    this.final = Float64Array.from(errors, (error, cell) => (isFinalPart[cell] ? error * this.step : NaN));
    const size = this.nx * this.ny;
    this.steps.length = this.jetted.length = this.planned.length = layers.first;
    for (let start = 0; start < differences.length; start += size) {
      const before = this.steps.at(-1) ?? new Int32Array(size);
      this.steps.push(before.map((step, cell) => step + differences[start + cell]));
      this.jetted.push(jetted.subarray(start, start + size));
      if (planned) this.planned.push(Float32Array.from(planned.subarray(start, start + size), (tenths) => tenths / 10));
    }
    return this;
  }

  get layers() {
    return this.steps.length;
  }

  heights(layer) {
    return Float64Array.from(this.steps[layer], (step) => step * this.step);
  }

  /* Target minus height over the part, NaN elsewhere. */
  errors(layer) {
    return this.heights(layer).map((height, cell) => (this.part[cell] ? this.target[cell] - height : NaN));
  }

  /* The cell of the part that is next to the middle of the grid. */
  middleCell() {
    const middle = { i: Math.floor(this.nx / 2), j: Math.floor(this.ny / 2) };
    const far = ({ i, j }) => Math.hypot(i - middle.i, j - middle.j);
    const cells = [...this.part.keys()].filter((cell) => this.part[cell]);
    const places = cells.map((cell) => ({ i: cell % this.nx, j: Math.floor(cell / this.nx) }));
    return places.reduce((best, place) => (far(place) < far(best) ? place : best), places[0] ?? middle);
  }

  /* Middles of blocks along an axis [mm]. */
  middles(axis) {
    const edges = this.edges[axis];
    return edges.slice(1).map((edge, k) => (edge + edges[k]) / 2);
  }
}
