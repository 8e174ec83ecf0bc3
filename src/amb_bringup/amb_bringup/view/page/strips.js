// Time traces: a strip per axis; each column of pixels spans the smallest and the largest sample behind it.

import { axisColour, colour, line, micro, prepared, seconds, short, ticks } from "./drawing.js";

const LEFT = 58, RIGHT = 10, TOP = 6, BOTTOM = 24, GAP = 8; // px
const THICKNESS = 1.3, OVERLAP = 0.4; // px, of the bars
const SHRINK = 0.97; // of a range per frame, so that the scale does not jump
const ranges = new Map(); // by signal and axis

export function drawStrips(canvas, samples, signal) {
  const { context, width, height } = prepared(canvas);
  const axes = samples.layout.axes;
  if (!axes.length) return;
  const strip = (height - TOP - BOTTOM - GAP * (axes.length - 1)) / axes.length;
  axes.forEach((name, axis) => {
    const box = { left: LEFT, right: width - RIGHT, top: TOP + axis * (strip + GAP), height: strip };
    drawStrip(context, box, samples, signal, axis, name);
  });
  drawTime(context, width, height, samples);
}

function drawStrip(context, box, samples, signal, axis, name) {
  const [low, high] = rangeOf(samples, signal, axis);
  const scale = signal === "current" ? 1 : 1e6;
  const y = (value) => box.top + (box.height * (high - value)) / (high - low);
  context.lineWidth = 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const tick of ticks(low * scale, high * scale, Math.max(2, box.height / 34))) {
    context.strokeStyle = colour("grid");
    line(context, box.left, y(tick / scale), box.right, y(tick / scale));
    context.fillStyle = colour("soft");
    context.fillText(`${+tick.toPrecision(6)}`, box.left - 6, y(tick / scale));
  }
  context.save();
  context.beginPath();
  context.rect(box.left, box.top, box.right - box.left, box.height);
  context.clip();
  if (signal === "position") band(context, box, samples, samples.index("reference", axis), y, colour("soft"), 0.3);
  band(context, box, samples, samples.index(signal, axis), y, axisColour(axis), 1);
  context.restore();
  const [least, most] = samples.column(0, samples.index(signal, axis));
  const text = `${name}  ${signal === "current" ? `${short((least + most) / 2)} A` : micro((least + most) / 2)}`;
  label(context, text, box.left + 6, box.top + 4, axisColour(axis));
}

// Bars, each reaching to the one before it: a browser without a graphics card draws them several times faster than a
// line of as many points.
function band(context, box, samples, signal, y, fill, alpha) {
  const columns = samples.layout.columns, step = (box.right - box.left) / (columns - 1);
  context.fillStyle = fill;
  context.globalAlpha = alpha;
  let lowBefore = NaN, highBefore = NaN; // after a gap both comparisons are false
  for (let back = columns - 1; back >= 0; back--) {
    const [low, high] = samples.column(back, signal);
    if (Number.isFinite(low) && Number.isFinite(high)) {
      const top = y(lowBefore > high ? lowBefore : high), bottom = y(highBefore < low ? highBefore : low);
      context.fillRect(box.right - (back + 1) * step, top - THICKNESS / 2, step + OVERLAP, bottom - top + THICKNESS);
    }
    [lowBefore, highBefore] = [low, high];
  }
  context.globalAlpha = 1;
}

// The range of a strip: it grows at once and shrinks slowly.
function rangeOf(samples, signal, axis) {
  let low = Infinity, high = -Infinity;
  for (let back = 0; back < samples.layout.columns; back++) {
    const [least, most] = samples.column(back, samples.index(signal, axis));
    if (least < low) low = least;
    if (most > high) high = most;
  }
  if (!(low <= high) || !Number.isFinite(high - low)) [low, high] = [-1e-6, 1e-6];
  const smallest = signal === "current" ? 1e-3 : 1e-7;
  const half = Math.max(0.58 * (high - low), smallest), middle = 0.5 * (low + high);
  const key = `${samples.layout.epoch} ${signal} ${axis}`, before = ranges.get(key);
  let range = [middle - half, middle + half];
  if (before) {
    range = [Math.min(range[0], middle - (middle - before[0]) * SHRINK), Math.max(range[1], middle + (before[1] - middle) * SHRINK)];
  } else if (ranges.size > 200) ranges.clear();
  ranges.set(key, range);
  return range;
}

function drawTime(context, width, height, samples) {
  const span = samples.layout.columns * samples.layout.columnTimes[samples.level];
  context.fillStyle = colour("soft");
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  for (const tick of ticks(-span, 0, width / 130)) {
    const x = width - RIGHT + ((width - LEFT - RIGHT) * tick) / span;
    context.textAlign = tick === 0 ? "right" : "center";
    if (x > LEFT) context.fillText(tick === 0 ? "now" : `−${seconds(-tick)}`, x, height - 6);
  }
}

export function label(context, text, x, y, fill) {
  context.textAlign = "left";
  context.textBaseline = "top";
  context.font = "600 12px system-ui, 'DejaVu Sans', sans-serif";
  context.fillStyle = colour("card");
  context.globalAlpha = 0.75;
  context.fillRect(x - 3, y - 2, context.measureText(text).width + 6, 17);
  context.globalAlpha = 1;
  context.fillStyle = fill;
  context.fillText(text, x, y);
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
}
