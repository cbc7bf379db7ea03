"use strict";
/* The page: texts, tables and charts, the choice of run, layer and cell, and, from `inkloop watch`, further layers. */

const PLATES = 100; /* along a side of the 3D picture at most */
const LOOK_MS = 500; /* between two questions to the server */
const CONFIG = { responsive: true, displaylogo: false, scrollZoom: false };
const BUTTONS = ["toImage", "zoom2d", "pan2d", "resetScale2d"], SOLID_BUTTONS = ["toImage", "orbitRotation", "resetCameraDefault3d"];
const page = { runs: [], run: 0, layer: 0, cell: null, along: "x", version: "", content: null };
const find = (id) => document.getElementById(id);

/* Texts of users go into the page as text, never as markup. */
const element = (name, textContent) => Object.assign(document.createElement(name), { textContent });

/* words: columns of text before those of numbers. */
function fillTable(table, { headings, rows, caption, words = Infinity }) {
  const row = (name, cells) => {
    const found = document.createElement("tr");
    found.append(...cells.map((text, k) => Object.assign(element(name, text), { className: k < words ? "" : "number" })));
    return found;
  };
  table.replaceChildren(element("caption", caption ?? ""), document.createElement("thead"), document.createElement("tbody"));
  table.tHead.append(...(headings ? [row("th", headings)] : []));
  table.tBodies[0].append(...rows.map((cells) => row("td", cells)));
}

function showTexts({ texts, tables, remarks }) {
  document.title = `${texts.title}: inkloop report`;
  Object.entries(texts).forEach(([id, text]) => { find(id).textContent = text; });
  Object.entries(tables).forEach(([id, table]) => fillTable(find(id), table));
  find("remarks").replaceChildren(...remarks.map((remark) => element("li", remark)));
  find("devices").hidden = !("nodes" in tables);
}

/* Draw a figure of plotly.py with the arrays of its traces and what the page adds to its layout; chosen: by a click. */
async function draw(place, figure, arrays = [], layout = {}, chosen = null) {
  const isNew = !place.data;
  const data = figure.data.map((trace, k) => ({ ...trace, ...arrays[k] }));
  const config = { ...CONFIG, modeBarButtons: [figure.layout.scene ? SOLID_BUTTONS : BUTTONS] };
  await Plotly.react(place, data, { template: page.content.template, ...figure.layout, ...layout }, config);
  if (isNew && chosen) place.on("plotly_click", (event) => chosen(event.points[0]));
}

/* A map of blocks, coarse or fine, with these edges along x and y. */
function heatmap([x, y], values, more = {}) {
  const width = x.length - 1;
  const rows = (all) => Array.from({ length: y.length - 1 }, (_, j) => all.subarray(j * width, (j + 1) * width));
  return { x, y, z: rows(values), ...(more.um ? { customdata: rows(more.um) } : {}) };
}

const onScale = (errors) => errors.map((error) => Math.asinh(error / page.content.width));
const errorMap = (edges, um) => heatmap(edges, onScale(um), { um });

/* The run and the cell of a click on a map. */
function choose(run, { x, y }, layer) {
  const { pitch, block } = page.runs[run];
  const [i, j] = [x, y].map((mm) => Math.floor((mm / pitch + 0.5) / block));
  Object.assign(page, { run, layer, cell: { i, j } });
  redraw();
}

async function showRuns() {
  const places = find("finals"), { curves, distribution } = page.content;
  page.runs.slice(places.children.length).forEach(() => places.append(Object.assign(element("div", ""), { className: "plot" })));
  [...places.children].slice(page.runs.length).forEach((place) => place.remove());
  await Promise.all(page.runs.map((run, k) => draw(places.children[k], run.charts.final, [errorMap(run.finalEdges, run.final)], {},
    (point) => choose(k, point, page.runs[k].layers - 1))));
  await draw(find("distribution"), distribution);
  await draw(find("curves"), curves, [], {}, ({ x }) => { page.layer = x; redraw(); });
}

async function showLayer() {
  const run = page.runs[page.run], last = run.layers - 1;
  page.layer = Math.min(page.layer, last);
  page.cell ??= run.middleCell();
  const { layer, cell: { i, j } } = page, errors = run.errors(layer);
  find("run").value = String(page.run);
  Object.assign(find("layer"), { max: last, value: layer });
  find("layer-number").textContent = `${layer} of ${last}`;
  find("readout").textContent = readout(run);
  find("blocks").textContent = run.block > 1 ? `Each value is the mean of a block of ${run.block} x ${run.block} cells: all cells would not fit into the page.` : "";
  const ring = { shapes: [{ type: "rect", x0: run.edges[0][i], x1: run.edges[0][i + 1], y0: run.edges[1][j], y1: run.edges[1][j + 1], line: { color: "#000", width: 2 } }] };
  const maps = { error: errorMap(run.edges, errors), surface: heatmap(run.edges, run.heights(layer)), droplets: heatmap(run.edges, run.jetted[layer]) };
  find("plan").hidden = !run.charts.plan;
  if (run.charts.plan) maps.plan = heatmap(run.edges, run.planned[layer]);
  await Promise.all([
    ...Object.entries(maps).map(([id, map]) => draw(find(id), run.charts[id], [map], ring, (point) => choose(page.run, point, page.layer))),
    draw(find("section"), run.charts.section, ...section(run, errors)),
    draw(find("solid"), run.charts.solid, solid(run, errors), camera(run.charts.solid.layout.scene)),
  ]);
}

function readout(run) {
  const { layer, cell } = page, index = cell.j * run.nx + cell.i;
  const height = run.steps[layer][index] * run.step, target = run.target[index], jetted = run.jetted[layer][index];
  const [x, y] = [cell.i, cell.j].map((k, axis) => run.middles(axis)[k].toFixed(3));
  const cells = [cell.i, cell.j].map((k) => (run.block > 1 ? `${k * run.block}…` : String(k)));
  const droplet = run.block > 1 ? `${jetted} % of the cells with a droplet` : ["no droplet", run.inks > 1 ? "ink A" : "a droplet", "ink B"][jetted];
  const judged = run.part[index] ? `, target ${target.toFixed(2)} µm: ${Math.abs(target - height).toFixed(2)} µm too ${target < height ? "high" : "low"}` : ", outside the part";
  return `Cell (${cells.join(", ")}) at x ${x} mm, y ${y} mm, layer ${layer}: height ${height.toFixed(2)} µm${judged}; ${droplet}.`;
}

/* Heights and errors on the row or column of blocks through the cell, with some ten earlier layers. */
function section(run, errors) {
  const { layer, cell } = page, isAlongX = page.along === "x";
  const [own, other, here, at] = isAlongX ? [0, 1, cell.i, cell.j] : [1, 0, cell.j, cell.i];
  const x = run.middles(own), across = run.middles(other)[at].toFixed(2);
  const cut = (values) => x.map((_, k) => values[isAlongX ? at * run.nx + k : k * run.nx + at]);
  const every = Math.max(1, Math.floor(layer / 10));
  const earlier = Array.from({ length: Math.ceil(layer / every) }, (_, k) => cut(run.heights(k * every)));
  const before = { x: earlier.flatMap(() => [...x, null]), y: earlier.flatMap((line) => [...line, null]) };
  const lines = [run.target, run.heights(layer), errors].map((values) => ({ x, y: cut(values) }));
  const line = { type: "line", x0: x[here], x1: x[here], yref: "paper", y0: 0, y1: 1, line: { color: "#999", width: 1, dash: "2px,2px" } };
  return [[before, ...lines], { shapes: [line], title: { text: `Cut at ${isAlongX ? "y" : "x"} = ${across} mm` },
    xaxis2: { ...run.charts.section.layout.xaxis2, title: { text: `${page.along} [mm]` } } }];
}

/* The surface as plates, one for each block, with upright walls between them. */
function solid(run, errors) {
  const by = Math.ceil(Math.max(run.nx, run.ny) / PLATES);
  const [xs, ys] = run.edges.map((edges) => edges.filter((_, k) => k % by === 0 || k === edges.length - 1));
  const nx = xs.length - 1, ny = ys.length - 1;
  const [heights, colours] = [run.heights(page.layer), errors].map((values) => coarser(run, values, by, nx, ny));
  const corners = { x: [], y: [], z: [] }, body = { i: [], j: [], k: [] }, tops = { i: [], j: [], k: [], intensity: [] };
  const face = (faces, a, b, c, d) => {
    faces.i.push(a, a);
    faces.j.push(b, c);
    faces.k.push(c, d);
  };
  heights.forEach((height, cell) => {
    const i = cell % nx, j = Math.floor(cell / nx), own = 4 * cell, right = own + 4, behind = own + 4 * nx;
    const isPart = !Number.isNaN(colours[cell]);
    corners.x.push(xs[i], xs[i + 1], xs[i + 1], xs[i]);
    corners.y.push(ys[j], ys[j], ys[j + 1], ys[j + 1]);
    corners.z.push(height, height, height, height);
    face(isPart ? tops : body, own, own + 1, own + 2, own + 3);
    if (isPart) tops.intensity.push(...onScale([colours[cell], colours[cell]]));
    if (i + 1 < nx) face(body, own + 1, right, right + 3, own + 2);
    if (j + 1 < ny) face(body, own + 3, own + 2, behind + 1, behind);
  });
  return [{ ...corners, ...body }, { ...corners, ...tops }];
}

/* Means over squares of `by` blocks a side, of those that have a number. */
function coarser(run, values, by, nx, ny) {
  const sums = new Float64Array(nx * ny), counts = new Float64Array(nx * ny);
  values.forEach((value, cell) => {
    if (Number.isNaN(value)) return;
    const wide = Math.floor(Math.floor(cell / run.nx) / by) * nx + Math.floor((cell % run.nx) / by);
    sums[wide] += value;
    counts[wide] += 1;
  });
  return sums.map((sum, wide) => sum / counts[wide]);
}

/* From farther away in a narrow window, where the picture is taller than wide. */
function camera(scene) {
  const far = find("solid").clientWidth < 600 ? 1.64 : 1, { eye, center } = scene.camera;
  return { scene: { ...scene, camera: { center, eye: { x: eye.x * far, y: eye.y * far, z: eye.z * far } } } };
}

/* Of the requests during a drawing the newest is drawn. */
let wanted = 0;
async function redraw() {
  if (wanted++) return;
  try {
    for (let seen = 0; seen !== wanted;) {
      seen = wanted;
      await showLayer();
    }
  } finally {
    wanted = 0;
  }
}

/* Take a content: the first one, or one with the layers that the page does not have yet. */
async function take(content) {
  const wasLast = page.runs.length === 0 || page.layer >= page.runs[page.run].layers - 1;
  page.content = content;
  page.runs = await Promise.all(content.runs.map((description, k) => (description.layers.first ? page.runs[k] : new Run()).add(description)));
  page.run = Math.min(page.run, page.runs.length - 1);
  if (wasLast) page.layer = Infinity;
  showTexts(content);
  find("run").replaceChildren(...page.runs.map((run, k) => new Option(run.name, String(k))));
  find("run-choice").hidden = page.runs.length < 2;
  await showRuns();
  await redraw();
  document.body.dataset.layers = page.runs.map((run) => run.layers).join(",");
}

/* Ask the server for what is new; the sentence on the run. */
async function look() {
  const known = page.runs.map((run) => run.layers).join(",");
  const query = `version=${page.version}&epoch=${page.content?.epoch ?? ""}&known=${known}`;
  const answer = await fetch(`content?${query}`, { cache: "no-store" }).catch(() => { throw new Error("no connection to inkloop watch"); });
  const content = answer.status === 204 ? page.content : await answer.json();
  if (content.problem) return content.problem;
  if (content !== page.content) await take(content);
  page.version = content.version;
  return content.texts.state;
}

async function follow() {
  const state = await look().catch((error) => `The page could not be updated: ${error.message}. It is tried again.`);
  if (find("state").textContent !== state) find("state").textContent = state;
  setTimeout(follow, LOOK_MS);
}

find("layer").addEventListener("input", (event) => { page.layer = Number(event.target.value); redraw(); });
find("run").addEventListener("change", (event) => { page.run = Number(event.target.value); redraw(); });
find("along").addEventListener("change", (event) => { page.along = event.target.value; redraw(); });
const resizeAll = () => document.querySelectorAll(".js-plotly-plot").forEach((plot) => Plotly.Plots.resize(plot));
window.addEventListener("beforeprint", resizeAll);
window.addEventListener("afterprint", resizeAll);

const stored = find("content");
if (stored) take(JSON.parse(stored.textContent));
else follow();
