"use strict";
/* The page: texts and tables, the choice of run, layer and cell, and, where a server sends it, further layers. */

const page = { runs: [], run: 0, layer: 0, cell: null, along: "x", scale: null, content: null };
const find = (id) => document.getElementById(id);

/* Texts of users go into the page as text, never as markup. */
function text(id, value) {
  find(id).textContent = value;
}

function fillTable(id, headings, lines, caption, numbersFrom = Infinity) {
  const table = find(id);
  table.replaceChildren();
  if (caption) table.createCaption().textContent = caption;
  const addRow = (section, tag, cells) => {
    const row = section.insertRow();
    cells.forEach((value, place) => {
      const cell = document.createElement(tag);
      cell.textContent = value;
      if (place >= numbersFrom) cell.className = "number";
      row.append(cell);
    });
  };
  if (headings) addRow(table.createTHead(), "th", headings);
  const body = table.createTBody();
  lines.forEach((line) => addRow(body, "td", line));
}

function showTexts(content) {
  document.title = `${content.title}: inkloop report`;
  text("title", content.title);
  text("state", content.state);
  fillTable("table", content.table.headings, content.table.rows, content.table.caption, 1);
  find("remarks").replaceChildren(...content.remarks.map((remark) => {
    const item = document.createElement("li");
    item.textContent = remark;
    return item;
  }));
  fillTable("metrology", null, content.metrology.rows, content.metrology.caption, 2);
  fillTable("facts", null, content.facts, null);
  text("scenario", content.scenario);
  find("devices").hidden = !content.devices;
  if (content.devices) {
    fillTable("nodes", ["node", "time", "", "last message"], content.devices.nodes, null);
    text("log", content.devices.log.join("\n"));
  }
}

function draw(id, chart, config = CONFIG) {
  const place = typeof id === "string" ? find(id) : id;
  return Plotly.react(place, chart.data, { font: FONT, ...chart.layout }, config);
}

/* A chart that Python has made, with the page's font and margins. */
function drawFigure(id, figure, margin) {
  const layout = { margin, paper_bgcolor: "#fff", plot_bgcolor: "#fff", ...figure.layout };
  return draw(id, { data: figure.data, layout });
}

/* A click on a cell of a map chooses it; coarse or fine, blocks are converted to those of the layers. */
function choosesCell(place, run, block) {
  place.removeAllListeners("plotly_click");
  place.on("plotly_click", (event) => {
    const [j, i] = event.points[0].pointIndex;
    const own = page.runs[run()];
    page.run = run();
    if (place.closest("#finals")) page.layer = own.layers - 1;
    page.cell = { i: Math.floor((i * block()) / own.block), j: Math.floor((j * block()) / own.block) };
    showLayer();
  });
}

async function showFinals() {
  const places = find("finals");
  while (places.children.length < page.runs.length) places.append(Object.assign(document.createElement("div"), { className: "plot" }));
  while (places.children.length > page.runs.length) places.lastChild.remove();
  await Promise.all(page.runs.map(async (run, number) => {
    const place = places.children[number];
    await draw(place, finalChart(run, page.scale));
    choosesCell(place, () => number, () => page.runs[number].final.block);
  }));
  await drawFigure("distribution", page.content.distribution, { l: 58, r: 10, t: 60, b: 84 });
  const curves = find("curves");
  await drawFigure("curves", page.content.curves, { l: 50, r: 10, t: 64, b: 44 });
  curves.removeAllListeners("plotly_click");
  curves.on("plotly_click", (event) => {
    page.layer = Math.min(event.points[0].x, page.runs[page.run].layers - 1);
    showLayer();
  });
}

const LAYER_MAPS = ["surface", "droplets", "error"];

async function showLayer() {
  const run = page.runs[page.run];
  page.layer = Math.min(page.layer, run.layers - 1);
  page.cell ??= { i: Math.floor(run.nx / 2), j: Math.floor(run.ny / 2) };
  const { layer, cell } = page;
  find("run").value = String(page.run);
  Object.assign(find("layer"), { max: run.layers - 1, value: layer });
  text("layer-number", `${layer} of ${run.layers - 1}`);
  text("readout", readout(run, layer, cell));
  text("blocks", run.block > 1 ? `Each value is the mean of a block of ${run.block} x ${run.block} cells: all cells would not fit into the page.` : "");
  const top = Math.max(extremes(run.target)[1], quantile(run.heights(run.layers - 1), 1));
  await Promise.all([
    draw("surface", surfaceChart(run, layer, cell, top)),
    draw("droplets", dropletChart(run, layer, cell)),
    draw("error", layerErrorChart(run, layer, cell, page.scale)),
    draw("section", sectionChart(run, layer, cell, page.along)),
    draw("solid", solidChart(run, layer, page.scale, find("solid").clientWidth < 600), SOLID_CONFIG),
  ]);
  LAYER_MAPS.forEach((id) => choosesCell(find(id), () => page.run, () => page.runs[page.run].block));
}

function readout(run, layer, cell) {
  const index = cell.i * run.ny + cell.j;
  const height = run.steps[layer][index] * run.step;
  const [x, y] = [cell.i, cell.j].map((k, axis) => middles(run.grid[axis], run.block, run.pitch)[k].toFixed(3));
  const cells = [cell.i, cell.j].map((k) => (run.block > 1 ? `${k * run.block}…` : String(k)));
  const jetted = run.jetted[layer][index];
  const droplet = run.block > 1 ? `${jetted} % of the cells with a droplet` : ["no droplet", run.inks > 1 ? "ink A" : "a droplet", "ink B"][jetted];
  const error = run.target[index] - height;
  const judged = run.part[index] ? `, target ${run.target[index].toFixed(2)} µm: ${Math.abs(error).toFixed(2)} µm too ${error < 0 ? "high" : "low"}` : ", outside the part";
  return `Cell (${cells.join(", ")}) at x ${x} mm, y ${y} mm, layer ${layer}: height ${height.toFixed(2)} µm${judged}; ${droplet}.`;
}

/* Of several requests while a drawing is under way only the newest is drawn. */
function newestOnly(work) {
  let running = false, wanted = false;
  return async () => {
    wanted = true;
    if (running) return;
    running = true;
    while (wanted) {
      wanted = false;
      await work();
    }
    running = false;
  };
}

/* Take a content: the first one, or one with the layers that the page does not have yet. */
async function take(content) {
  const wasLast = page.runs.length === 0 || page.layer >= page.runs[page.run].layers - 1;
  page.content = content;
  page.runs = await Promise.all(content.runs.map(async (description, number) => {
    const run = description.layers.first > 0 ? page.runs[number] : new Run(description);
    await run.add(description);
    return run;
  }));
  page.scale = new ErrorScale(page.runs);
  if (wasLast) page.layer = Infinity;
  showTexts(content);
  find("run").replaceChildren(...page.runs.map((run, number) => new Option(run.name, String(number))));
  find("run-choice").hidden = page.runs.length < 2;
  await showFinals();
  await showLayer();
  document.body.dataset.layers = page.runs.map((run) => run.layers).join(",");
}

/* The server says that there is something new; the page asks for it when it has drawn what it had. */
function follow() {
  let epoch = "";
  const update = newestOnly(async () => {
    const known = page.runs.map((run) => run.layers).join(",");
    const answer = await fetch(`content?epoch=${epoch}&known=${known}`, { cache: "no-store" });
    const content = await answer.json();
    if (content.problem) text("state", content.problem);
    else if (content.runs) {
      epoch = content.epoch;
      await take(content);
    }
  });
  const events = new EventSource("events");
  events.onmessage = () => update().catch((error) => text("state", `The page could not be updated: ${error.message}`));
  events.onerror = () => text("state", `${page.content?.state ?? ""} No connection to inkloop watch; it is tried again.`);
}

const redraw = newestOnly(showLayer);
find("layer").addEventListener("input", (event) => { page.layer = Number(event.target.value); redraw(); });
find("run").addEventListener("change", (event) => { page.run = Number(event.target.value); redraw(); });
find("along").addEventListener("change", (event) => { page.along = event.target.value; redraw(); });
const resizeAll = () => document.querySelectorAll(".js-plotly-plot").forEach((plot) => Plotly.Plots.resize(plot));
window.addEventListener("beforeprint", resizeAll);
window.addEventListener("afterprint", resizeAll);

const stored = find("content");
if (stored) take(JSON.parse(stored.textContent));
else follow();
