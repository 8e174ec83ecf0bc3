// Running spectrum of the positions: amplitude over frequency, both logarithmic.

import { axisColour, colour, line, prepared } from "./drawing.js";

const LEFT = 66, RIGHT = 10, TOP = 8, BOTTOM = 30; // px
const DECADES = 5; // shown below the largest line
const FLOOR = -10; // decade in m, 0.1 nm: below it is no motion that a sensor sees

// First and last decade (m) of the axis for the largest line.
export function decades(largest) {
  const top = Math.max(Math.ceil(Math.log10(largest) + 0.1), FLOOR + 2);
  return [Math.max(top - DECADES, FLOOR), top];
}

export function drawSpectrum(canvas, samples) {
  const { context, width, height } = prepared(canvas);
  const { axes, frequency } = samples.layout, spectrum = samples.spectrum;
  if (!axes.length || !spectrum) {
    context.fillStyle = colour("soft");
    context.fillText(axes.length ? "collecting samples" : "no samples yet", LEFT, height / 2);
    return;
  }
  const largest = spectrum.reduce((most, value) => (value > most && Number.isFinite(value) ? value : most), 0);
  const [bottom, top] = decades(largest);
  const first = Math.log10(frequency[0]), last = Math.log10(frequency.at(-1));
  const x = (value) => LEFT + ((width - LEFT - RIGHT) * (Math.log10(value) - first)) / (last - first);
  const y = (value) => TOP + ((height - TOP - BOTTOM) * (top - Math.max(bottom, Math.log10(value)))) / (top - bottom);
  grid(context, { x, y, top, bottom, first, last, width, height });
  axes.forEach((_, axis) => {
    context.strokeStyle = axisColour(axis);
    context.lineWidth = 1.3;
    context.beginPath();
    for (let point = 0; point < frequency.length; point++) {
      context.lineTo(x(frequency[point]), y(Math.max(spectrum[point * axes.length + axis], 1e-300)));
    }
    context.stroke();
  });
  legend(context, axes, width);
}

function grid(context, { x, y, top, bottom, first, last, width, height }) {
  context.strokeStyle = colour("grid");
  context.fillStyle = colour("soft");
  context.lineWidth = 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (let decade = bottom; decade <= top; decade++) {
    line(context, LEFT, y(10 ** decade), width - RIGHT, y(10 ** decade));
    const micrometres = decade + 6;
    context.fillText(micrometres >= -3 ? `${+(10 ** micrometres).toPrecision(3)} µm` : `1e${micrometres} µm`, LEFT - 5, y(10 ** decade));
  }
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  for (let decade = Math.floor(first); decade <= last; decade++) {
    for (const factor of [1, 2, 5]) {
      const frequency = factor * 10 ** decade;
      if (Math.log10(frequency) < first || Math.log10(frequency) > last) continue;
      line(context, x(frequency), TOP, x(frequency), height - BOTTOM);
      const text = frequency >= 1000 ? `${frequency / 1000} kHz` : `${frequency} Hz`;
      if (factor === 1 || width > 420) context.fillText(text, Math.min(x(frequency), width - 24), height - 12);
    }
  }
}

function legend(context, axes, width) {
  context.textBaseline = "top";
  context.textAlign = "right";
  let right = width - RIGHT - 6;
  [...axes].reverse().forEach((name, back) => {
    context.fillStyle = axisColour(axes.length - 1 - back);
    context.fillText(name, right, TOP + 4);
    right -= context.measureText(name).width + 14;
  });
}
