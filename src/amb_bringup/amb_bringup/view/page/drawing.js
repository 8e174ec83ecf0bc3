// What all drawings share: a sharp canvas, colours of the theme, round tick marks, units.

let colours = {};

export function readColours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["card", "text", "soft", "line", "grid", "a", "b", "c", "d", "s1", "s2", "s3", "s4", "s5", "s6"];
  colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

export const colour = (name) => colours[name];
export const axisColour = (axis) => colours[`s${(axis % 6) + 1}`];

// The context of a canvas, cleared, in CSS pixels; with its width and height.
export function prepared(canvas) {
  const scale = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  context.lineJoin = "bevel";
  return { context, width, height };
}

// Round values between two limits, about `count` of them.
export function ticks(low, high, count) {
  const raw = (high - low) / Math.max(1, count), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= raw) || power;
  const values = [];
  for (let value = Math.ceil(low / step) * step; value <= high + 1e-9 * step && values.length < 50; value += step) {
    values.push(Math.abs(value) < 1e-9 * step ? 0 : value);
  }
  return values;
}

export function line(context, x1, y1, x2, y2) {
  context.beginPath();
  context.moveTo(x1, y1);
  context.lineTo(x2, y2);
  context.stroke();
}

// A number with about three digits.
export function short(value) {
  if (value === null || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return value.toFixed(size >= 100 || size === 0 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}

export const micro = (value) => (value === null ? "–" : `${short(value * 1e6)} µm`);
export const hertz = (value) => (value === null ? "–" : `${short(value)} Hz`);
export const percent = (value) => (value === null ? "–" : `${short(100 * value)} %`);
export const seconds = (value) => (value < 1 ? `${+(1000 * value).toPrecision(3)} ms` : `${+value.toPrecision(3)} s`);
