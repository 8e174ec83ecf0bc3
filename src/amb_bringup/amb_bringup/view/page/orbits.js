// Orbits: the path of the rotor in the plane of each radial bearing, and the clearance circle.

import { axisColour, colour, line, micro, prepared, ticks } from "./drawing.js";
import { label } from "./strips.js";

const SMALLEST = 1e-6; // m; half the width of the smallest picture
const GROUPS = 10; // of points, from faded to full
const sizes = new Map(); // half width by bearing, which shrinks slowly

export function makeOrbits(grid, layout) {
  grid.replaceChildren(...(layout.planes || []).map((plane) => {
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Orbit in bearing ${plane.bearing}`);
    return canvas;
  }));
}

export function drawOrbits(grid, samples, whole) {
  [...grid.children].forEach((canvas, plane) => drawOrbit(canvas, samples, plane, whole));
}

function drawOrbit(canvas, samples, plane, whole) {
  const { context, width, height } = prepared(canvas);
  const { bearing, clearance } = samples.layout.planes[plane];
  const points = orderedPoints(samples, plane);
  const view = whole && clearance ? { x: 0, y: 0, half: 1.12 * clearance } : fitted(points, bearing);
  const scale = Math.min(width, height) / 2 / view.half;
  const x = (value) => width / 2 + (value - view.x) * scale, y = (value) => height / 2 - (value - view.y) * scale;
  drawGrid(context, view, width, height, x, y);
  if (clearance) {
    context.strokeStyle = colour("d");
    context.lineWidth = 1.5;
    context.setLineDash([6, 4]);
    context.beginPath();
    context.arc(x(0), y(0), clearance * scale, 0, 2 * Math.PI);
    context.stroke();
    context.setLineDash([]);
  }
  drawPath(context, points, x, y, axisColour(2 * plane));
  label(context, `bearing ${bearing}`, 6, 5, colour("text"));
}

// The points of a plane, oldest first.
function orderedPoints(samples, plane) {
  const kept = samples.layout.orbitPoints, planes = samples.layout.planes.length, points = [];
  for (let number = Math.max(0, samples.pointEnd - kept); number < samples.pointEnd; number++) {
    const place = ((number % kept) * planes + plane) * 2;
    points.push([samples.points[place], samples.points[place + 1]]);
  }
  return points;
}

function fitted(points, bearing) {
  let left = Infinity, right = -Infinity, bottom = Infinity, top = -Infinity;
  for (const [x, y] of points) {
    if (!Number.isFinite(x + y)) continue;
    left = Math.min(left, x);
    right = Math.max(right, x);
    bottom = Math.min(bottom, y);
    top = Math.max(top, y);
  }
  if (!(left <= right)) [left, right, bottom, top] = [0, 0, 0, 0];
  const wanted = Math.max(SMALLEST, 0.65 * Math.max(right - left, top - bottom));
  const half = Math.max(wanted, 0.97 * (sizes.get(bearing) || 0));
  sizes.set(bearing, half);
  return { x: (left + right) / 2, y: (bottom + top) / 2, half };
}

function drawGrid(context, view, width, height, x, y) {
  context.lineWidth = 1;
  context.strokeStyle = colour("grid");
  context.fillStyle = colour("soft");
  context.textBaseline = "bottom";
  for (const tick of ticks((view.x - view.half) * 1e6, (view.x + view.half) * 1e6, 4)) {
    line(context, x(tick * 1e-6), 0, x(tick * 1e-6), height);
    context.textAlign = "center";
    if (x(tick * 1e-6) > 40 && x(tick * 1e-6) < width - 16) context.fillText(`${+tick.toPrecision(6)}`, x(tick * 1e-6), height - 2);
  }
  for (const tick of ticks((view.y - view.half) * 1e6, (view.y + view.half) * 1e6, 4)) {
    line(context, 0, y(tick * 1e-6), width, y(tick * 1e-6));
    context.textAlign = "left";
    if (y(tick * 1e-6) < height - 24 && y(tick * 1e-6) > 36) context.fillText(`${+tick.toPrecision(6)}`, 3, y(tick * 1e-6) - 1);
  }
  context.textAlign = "right";
  context.fillText("µm", width - 4, 18);
}

function drawPath(context, points, x, y, stroke) {
  context.strokeStyle = stroke;
  context.lineWidth = 1.4;
  const size = Math.ceil(points.length / GROUPS);
  for (let group = 0; group < GROUPS; group++) {
    context.globalAlpha = (group + 1) / GROUPS;
    context.beginPath();
    let started = false;
    for (const [px, py] of points.slice(group * size, (group + 1) * size + 1)) {
      if (!Number.isFinite(px + py)) started = false;
      else if (started) context.lineTo(x(px), y(py));
      else {
        context.moveTo(x(px), y(py));
        started = true;
      }
    }
    context.stroke();
  }
  context.globalAlpha = 1;
  const last = points.at(-1);
  if (!last || !Number.isFinite(last[0] + last[1])) return;
  context.fillStyle = stroke;
  context.beginPath();
  context.arc(x(last[0]), y(last[1]), 4, 0, 2 * Math.PI);
  context.fill();
}

export const where = (samples, plane) => orderedPoints(samples, plane).at(-1)?.map(micro);
