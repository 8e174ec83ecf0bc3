// The region map, and where on it each axis runs: amplitude over frequency of its excitation, both logarithmic.

import { axisColour, colour, line, prepared } from "./drawing.js";

const LEFT = 58, RIGHT = 10, TOP = 8, BOTTOM = 28; // px
const TRAIL = 400; // points per axis
const SINGLE = 1.1; // ratio of amplitudes from a map's only sweep to the ends of its areas
const REGIONS = { B: [6, 4], C: [8, 3, 2, 3], D: [] }; // dash of the boundary
const trails = new Map();
let trailRun = null;

// Notes the operating points of a region state; a run of its own has trails of its own.
export function noteRegion(region) {
  if (region.run !== trailRun) trails.clear();
  trailRun = region.run;
  for (const axis of region.axes) {
    const [amplitude, frequency] = axis.input, trail = trails.get(axis.name) || [];
    if (amplitude > 0 && frequency > 0) trail.push([frequency, amplitude]);
    if (trail.length > TRAIL) trail.shift();
    trails.set(axis.name, trail);
  }
}

export function drawMap(canvas, map, region) {
  const { context, width, height } = prepared(canvas);
  const view = rangeOf(map);
  const x = (value) => LEFT + ((width - LEFT - RIGHT) * Math.log(value / view.from)) / Math.log(view.to / view.from);
  const y = (value) => height - BOTTOM - ((height - TOP - BOTTOM) * Math.log(value / view.low)) / Math.log(view.high / view.low);
  if (map) drawAreas(context, map, x, y, width);
  grid(context, view, x, y, width, height);
  if (map) drawBoundaries(context, map, x, y);
  context.save();
  context.beginPath();
  context.rect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
  context.clip();
  (region?.axes || []).forEach((axis, number) => drawPoint(context, axis, axisColour(number), x, y));
  context.restore();
}

function rangeOf(map) {
  let from = 5, to = 5000, low = 1e-6, high = 200e-6;
  if (map) {
    const frequencies = [...Object.values(map.boundaries).flat(), ...map.highest, ...map.frequencies].filter((f) => f > 0);
    [from, to] = [Math.min(...frequencies), Math.max(...frequencies)];
    [low, high] = [map.amplitude[0] / 1.6, map.amplitude.at(-1) * 1.6];
  }
  for (const trail of trails.values()) {
    for (const [frequency, amplitude] of trail) {
      from = Math.min(from, frequency);
      to = Math.max(to, frequency);
      low = Math.min(low, amplitude / 1.3);
      high = Math.max(high, amplitude * 1.3);
    }
  }
  return { from, to, low, high };
}

// The boundary of a region as runs of points [frequency, amplitude], one run for neighbouring sweeps that have it. It
// ends half-way to a neighbour that lacks it.
export function boundaryOf(map, name) {
  const { amplitude, boundaries } = map, frequencies = boundaries[name], runs = [];
  const alone = amplitude.length === 1 ? SINGLE : 1;
  const halfWay = (sweep, step) => Math.sqrt(amplitude[sweep] * (amplitude[sweep + step] ?? amplitude[sweep] * alone ** (2 * step)));
  const lacks = (sweep) => (frequencies[sweep] ?? null) === null;
  frequencies.forEach((frequency, sweep) => {
    if (lacks(sweep)) return;
    if (lacks(sweep - 1)) runs.push([[frequency, halfWay(sweep, -1)]]);
    runs.at(-1).push([frequency, amplitude[sweep]]);
    if (lacks(sweep + 1)) runs.at(-1).push([frequency, halfWay(sweep, 1)]);
  });
  return runs;
}

// From each boundary to the right edge: what lies behind a further boundary is tinted by both.
function drawAreas(context, map, x, y, width) {
  context.globalAlpha = 0.16;
  for (const name of Object.keys(REGIONS)) {
    context.fillStyle = colour(name.toLowerCase());
    for (const run of boundaryOf(map, name)) {
      context.beginPath();
      for (const [frequency, amplitude] of run) context.lineTo(x(frequency), y(amplitude));
      context.lineTo(width - RIGHT, y(run.at(-1)[1]));
      context.lineTo(width - RIGHT, y(run[0][1]));
      context.fill();
    }
  }
  context.globalAlpha = 1;
}

function drawBoundaries(context, map, x, y) {
  context.lineWidth = 2;
  for (const [name, dash] of Object.entries(REGIONS)) {
    const runs = boundaryOf(map, name);
    context.strokeStyle = context.fillStyle = colour(name.toLowerCase());
    context.setLineDash(dash);
    for (const run of runs) {
      context.beginPath();
      for (const [frequency, amplitude] of run) context.lineTo(x(frequency), y(amplitude));
      context.stroke();
    }
    context.setLineDash([]);
    context.textAlign = "left";
    context.textBaseline = "top";
    if (!runs.length) continue;
    const [frequency, amplitude] = runs.at(-1).at(-1);
    context.fillText(name, x(frequency) + 4, y(amplitude) + 2);
  }
}

function grid(context, view, x, y, width, height) {
  context.strokeStyle = colour("grid");
  context.fillStyle = colour("soft");
  context.lineWidth = 1;
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  for (let decade = Math.floor(Math.log10(view.from)); 10 ** decade <= view.to; decade++) {
    const value = 10 ** decade;
    if (value < view.from) continue;
    line(context, x(value), TOP, x(value), height - BOTTOM);
    context.fillText(value >= 1000 ? `${value / 1000} kHz` : `${value} Hz`, Math.min(x(value), width - 20), height - 12);
  }
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (let decade = Math.floor(Math.log10(view.low)); 10 ** decade <= view.high; decade++) {
    for (const value of [10 ** decade, 3 * 10 ** decade]) {
      if (value < view.low || value > view.high) continue;
      line(context, LEFT, y(value), width - RIGHT, y(value));
      context.fillText(`${+(value * 1e6).toPrecision(2)} µm`, LEFT - 4, y(value));
    }
  }
}

function drawPoint(context, axis, fill, x, y) {
  const trail = trails.get(axis.name) || [];
  context.strokeStyle = context.fillStyle = fill;
  context.lineWidth = 1.5;
  context.globalAlpha = 0.6;
  context.beginPath();
  for (const [frequency, amplitude] of trail) context.lineTo(x(frequency), y(amplitude));
  context.stroke();
  context.globalAlpha = 1;
  const [amplitude, frequency] = axis.input;
  if (!(amplitude > 0 && frequency > 0)) return;
  context.beginPath();
  context.arc(x(frequency), y(amplitude), 5, 0, 2 * Math.PI);
  context.fill();
  context.strokeStyle = colour("text");
  context.stroke();
}
