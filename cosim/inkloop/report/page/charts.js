"use strict";
/* Charts of maps: one function each, from a run and a layer to what `Plotly.react` takes. */

const ERROR_COLOURS = ["#67001f", "#b2182b", "#d6604d", "#f4a582", "#fddbc7", "#f7f7f7", "#d1e5f0", "#92c5de", "#4393c3",
  "#2166ac", "#053061"];
const HEIGHT_COLOURS = [[0, "#ffffff"], [0.5, "#7db0da"], [1, "#08306b"]];
const INK_COLOURS = ["#f3f3f3", "#0b5fa5", "#d9a441"];
const FONT = { family: 'system-ui, "Segoe UI", "DejaVu Sans", sans-serif', size: 12, color: "#1b1b1b" };
const PLATES = 100; /* along a side of the 3D picture at most */
const CONFIG = { responsive: true, displaylogo: false, scrollZoom: false,
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]] };
const SOLID_CONFIG = { ...CONFIG, modeBarButtons: [["toImage", "orbitRotation", "resetCameraDefault3d"]] };

/* A scale for errors [um] that grows like a logarithm beyond `width`: that of the PNG pictures. */
class ErrorScale {
  constructor(runs) {
    const far = runs.map((run) => Math.max(1e-3, quantile(run.final.errors.map(Math.abs), 0.99)));
    this.width = Math.min(...far) / 2;
    this.limit = Math.max(...far);
  }

  shown(error) {
    return Math.asinh(error / this.width);
  }

  /* Colours and colour bar, with at most three round numbers on either side. */
  axis() {
    const round = [];
    for (let power = -3; power <= 5; power++) round.push(...[1, 2, 5].map((digit) => digit * 10 ** power));
    const inside = round.filter((value) => value >= this.width && value <= this.limit);
    const kept = inside.filter((_, place) => (inside.length - 1 - place) % Math.ceil(inside.length / 3) === 0);
    const values = [...kept.map((value) => -value).reverse(), 0, ...kept];
    const end = this.shown(this.limit);
    return {
      zmin: -end, zmax: end,
      colorscale: ERROR_COLOURS.map((colour, place) => [place / (ERROR_COLOURS.length - 1), colour]),
      colorbar: { ...BAR, title: { text: "target - height [µm]<br>- too high, + too low", side: "bottom" },
        tickvals: values.map((value) => this.shown(value)), ticktext: values.map((value) => String(+value.toPrecision(3))) },
    };
  }
}

/* From above and the right, so that ground and walls differ. */
const LIGHT = { x: 70000, y: -20000, z: 100000 };

const BAR = { orientation: "h", thickness: 10, lenmode: "pixels", len: 240, y: -0.17, yanchor: "top", outlinewidth: 0.5 };

/* A text of the user for Plotly, which knows some markup: nothing in it is any. */
function plainText(text) {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
}

function layoutOfMap(title) {
  return {
    font: FONT, title: { text: plainText(title), font: { ...FONT, size: 14 }, x: 0.02, y: 0.98, yanchor: "top" },
    margin: { l: 46, r: 10, t: 44, b: 106 }, plot_bgcolor: "#ececec", paper_bgcolor: "#ffffff", hovermode: "closest",
    xaxis: { title: { text: "x [mm]", standoff: 4 }, constrain: "domain", showgrid: false, zeroline: false, ticks: "outside" },
    yaxis: { title: { text: "y [mm]", standoff: 4 }, constrain: "domain", showgrid: false, zeroline: false, ticks: "outside",
      scaleanchor: "x" },
  };
}

function heatmap(run, map, z, more) {
  return { type: "heatmap", x: edges(run.grid[0], map.block, run.pitch), y: edges(run.grid[1], map.block, run.pitch),
    z: rows(z, map.nx, map.ny), hoverongaps: false, ...more };
}

/* A ring around the cell that the read-out is about. */
function marked(run, cell) {
  const [left, right] = edges(run.grid[0], run.block, run.pitch).slice(cell.i, cell.i + 2);
  const [low, high] = edges(run.grid[1], run.block, run.pitch).slice(cell.j, cell.j + 2);
  return [{ type: "rect", x0: left, x1: right, y0: low, y1: high, line: { color: "#000", width: 2 } }];
}

function errorChart(run, map, errors, scale, title) {
  const trace = heatmap(run, map, errors.map((error) => scale.shown(error)), {
    ...scale.axis(), customdata: rows(errors, map.nx, map.ny),
    hovertemplate: "x %{x:.2f} mm, y %{y:.2f} mm<br>target - height %{customdata:.2f} µm<extra></extra>",
  });
  return { data: [trace], layout: layoutOfMap(title) };
}

function finalChart(run, scale) {
  return errorChart(run, run.final, run.final.errors, scale, run.name);
}

function layerErrorChart(run, layer, cell, scale) {
  const chart = errorChart(run, run, run.errors(layer), scale, "Error");
  chart.layout.shapes = marked(run, cell);
  return chart;
}

function surfaceChart(run, layer, cell, top) {
  const trace = heatmap(run, run, run.heights(layer), {
    colorscale: HEIGHT_COLOURS, zmin: 0, zmax: top,
    colorbar: { ...BAR, title: { text: "height [µm]", side: "bottom" } },
    hovertemplate: "x %{x:.2f} mm, y %{y:.2f} mm<br>height %{z:.2f} µm<extra></extra>",
  });
  return { data: [trace], layout: { ...layoutOfMap("Surface"), shapes: marked(run, cell) } };
}

function dropletChart(run, layer, cell) {
  const inks = run.inks > 1 ? ["none", "ink A", "ink B"] : ["none", "droplet"];
  const isShare = run.block > 1;
  const steps = inks.flatMap((_, ink) => [[ink / inks.length, INK_COLOURS[ink]], [(ink + 1) / inks.length, INK_COLOURS[ink]]]);
  const look = isShare
    ? { colorscale: [[0, INK_COLOURS[0]], [1, INK_COLOURS[1]]], zmin: 0, zmax: 100,
      colorbar: { ...BAR, title: { text: "cells with a droplet [%]", side: "bottom" } } }
    : { colorscale: steps, zmin: -0.5, zmax: inks.length - 0.5,
      colorbar: { ...BAR, tickvals: inks.map((_, ink) => ink), ticktext: inks, title: { text: "jetted in the layer", side: "bottom" } } };
  const hover = `x %{x:.2f} mm, y %{y:.2f} mm<br>%{z}${isShare ? " %" : ""}<extra></extra>`;
  const trace = heatmap(run, run, run.jetted[layer], { ...look, hovertemplate: hover });
  return { data: [trace], layout: { ...layoutOfMap("Droplets"), shapes: marked(run, cell) } };
}

/* Heights and errors on the row or column of blocks through a cell; grey: earlier layers. */
function sectionChart(run, layer, cell, along) {
  const [own, other, count] = along === "x" ? [0, 1, run.nx] : [1, 0, run.ny];
  const place = middles(run.grid[own], run.block, run.pitch);
  const across = middles(run.grid[other], run.block, run.pitch)[along === "x" ? cell.j : cell.i];
  const index = (k) => (along === "x" ? k * run.ny + cell.j : cell.i * run.ny + k);
  const cut = (values) => Array.from({ length: count }, (_, k) => values[index(k)]);
  const line = (y, more) => ({ type: "scatter", mode: "lines", x: place, y, line: { shape: "hvh", ...more.line }, ...more.trace });
  const every = Math.max(1, Math.floor(layer / 10));
  const before = { x: [], y: [] };
  for (let earlier = 0; earlier < layer; earlier += every) {
    before.x.push(...place, null);
    before.y.push(...cut(run.steps[earlier]).map((step) => step * run.step), null);
  }
  const data = [
    { type: "scatter", mode: "lines", ...before, line: { shape: "hvh", color: "#c9c9c9", width: 0.7 }, name: "before", hoverinfo: "skip" },
    line(cut(run.target), { line: { color: "#000", width: 1, dash: "4px,3px" }, trace: { name: "target" } }),
    line(cut(run.heights(layer)), { line: { color: "#0b5fa5", width: 2 }, trace: { name: "surface" } }),
    line(cut(run.errors(layer)), { line: { color: "#0b5fa5", width: 1.5 },
      trace: { name: "error", yaxis: "y2", showlegend: false, connectgaps: false } }),
  ];
  const here = place[along === "x" ? cell.i : cell.j];
  const grid = { gridcolor: "#e4e4e4", zeroline: false, hoverformat: ".2f" };
  return { data, layout: {
    font: FONT, margin: { l: 70, r: 10, t: 64, b: 42 }, hovermode: "x",
    title: { text: `Cut at ${along === "x" ? "y" : "x"} = ${across.toFixed(2)} mm`, font: { ...FONT, size: 14 }, x: 0.02, y: 0.98, yanchor: "top" },
    legend: { orientation: "h", x: 0, y: 1.0, yanchor: "bottom" },
    xaxis: { ...grid, title: { text: `${along} [mm]`, standoff: 4 }, anchor: "y2", hoverformat: ".2f" },
    yaxis: { ...grid, title: { text: "height [µm]", standoff: 4 }, domain: [0.46, 1], rangemode: "tozero" },
    yaxis2: { ...grid, title: { text: "+ too low<br>- too high [µm]", standoff: 4 }, domain: [0, 0.36], zeroline: true, zerolinecolor: "#000" },
    shapes: [{ type: "line", x0: here, x1: here, yref: "paper", y0: 0, y1: 1, line: { color: "#999", width: 1, dash: "2px,2px" } }],
  } };
}

/* The surface as plates, one for each block, with upright walls between them; tops of the part are coloured by their error. */
function solidChart(run, layer, scale, isNarrow) {
  const block = Math.ceil(Math.max(run.nx, run.ny) / PLATES);
  const { nx, ny, heights, errors } = coarser(run, layer, block);
  const [xs, ys] = run.grid.map((cells) => edges(cells, run.block * block, run.pitch));
  const corners = { x: [], y: [], z: [] };
  const tops = { i: [], j: [], k: [], intensity: [] }, body = { i: [], j: [], k: [] };
  const face = (faces, a, b, c, d) => {
    faces.i.push(a, a);
    faces.j.push(b, c);
    faces.k.push(c, d);
  };
  for (let cell = 0; cell < nx * ny; cell++) {
    const i = Math.floor(cell / ny), j = cell % ny, own = 4 * cell;
    corners.x.push(xs[i], xs[i + 1], xs[i + 1], xs[i]);
    corners.y.push(ys[j], ys[j], ys[j + 1], ys[j + 1]);
    corners.z.push(...Array(4).fill(heights[cell]));
    face(Number.isNaN(errors[cell]) ? body : tops, own, own + 1, own + 2, own + 3);
    if (!Number.isNaN(errors[cell])) tops.intensity.push(...Array(2).fill(scale.shown(errors[cell])));
    const [right, behind] = [own + 4 * ny, own + 4];
    if (i + 1 < nx) face(body, own + 1, right, right + 3, own + 2);
    if (j + 1 < ny) face(body, own + 3, own + 2, behind + 1, behind);
  }
  const { zmin, zmax, colorscale, colorbar } = scale.axis();
  const look = { type: "mesh3d", ...corners, flatshading: true, hovertemplate: "x %{x:.2f} mm, y %{y:.2f} mm<br>height %{z:.1f} µm<extra></extra>" };
  const sides = run.grid.map((cells) => cells / Math.max(...run.grid));
  const away = isNarrow ? 1.8 : 1.1;
  const finite = [...heights, ...run.target].filter(Number.isFinite);
  const [bottom, top] = [Math.min(0, ...extremes(finite)), Math.max(1, ...extremes(finite))];
  const stretched = 0.5 / (top - bottom) / (1.2 * sides[0] / ((xs.at(-1) - xs[0]) * 1000));
  return {
    data: [
      { ...look, ...body, color: "#b4b4b4", lighting: { ambient: 0.45, diffuse: 0.65, specular: 0 }, lightposition: LIGHT },
      { ...look, ...tops, intensitymode: "cell", cmin: zmin, cmax: zmax, colorscale,
        colorbar: { ...colorbar, y: -0.02 }, lighting: { ambient: 0.95, diffuse: 0.1, specular: 0 } },
    ],
    layout: {
      font: FONT, margin: { l: 0, r: 0, t: 34, b: 84 }, uirevision: "camera",
      title: { text: `Surface in 3D, heights × ${stretched.toPrecision(2)}`, font: { ...FONT, size: 14 }, x: 0.01, y: 0.98, yanchor: "top" },
      scene: { aspectmode: "manual", aspectratio: { x: 1.2 * sides[0], y: 1.2 * sides[1], z: 0.5 },
        camera: { eye: { x: 0.85 * away, y: -1.25 * away, z: 0.9 * away }, center: { x: 0, y: 0, z: -0.15 } },
        xaxis: { title: { text: "x [mm]" }, range: [xs[0], xs.at(-1)] }, yaxis: { title: { text: "y [mm]" }, range: [ys[0], ys.at(-1)] },
        zaxis: { title: { text: "height [µm]" }, nticks: 5, range: [bottom, top] } },
    },
  };
}

/* Least and greatest of many numbers; a million arguments are too many for Math.max. */
function extremes(values) {
  return values.reduce(([least, greatest], value) => [Math.min(least, value), Math.max(greatest, value)], [Infinity, -Infinity]);
}

/* Means over squares of blocks, of those that have a number. */
function coarser(run, layer, block) {
  const fine = { heights: run.heights(layer), errors: run.errors(layer) };
  if (block === 1) return { nx: run.nx, ny: run.ny, ...fine };
  const nx = Math.ceil(run.nx / block), ny = Math.ceil(run.ny / block);
  const means = (values) => {
    const sums = new Float64Array(nx * ny), counts = new Float64Array(nx * ny);
    values.forEach((value, cell) => {
      if (Number.isNaN(value)) return;
      const wide = Math.floor(Math.floor(cell / run.ny) / block) * ny + Math.floor((cell % run.ny) / block);
      sums[wide] += value;
      counts[wide] += 1;
    });
    return sums.map((sum, wide) => (counts[wide] ? sum / counts[wide] : NaN));
  };
  return { nx, ny, heights: means(fine.heights), errors: means(fine.errors) };
}
