// What the frames carry: columns of the time traces, points of the orbits, the spectrum. Rings of fixed length.

const FRAME = 1, SPECTRUM = 2;
const FRAME_HEADER = 64, SPECTRUM_HEADER = 16; // bytes; as in samples.py

export class Samples {
  constructor() {
    this.layout = { epoch: -1, axes: [] };
    this.step = this.time = 0; // after the newest sample; s
    this.published = this.sent = 0; // s since the epoch
    this.level = 2;
  }

  use(layout) {
    this.layout = layout;
    this.signals = layout.axes.length * (layout.signals || []).length;
    this.spectrum = null;
    this.spectrumIsNew = true; // that of the layout before is drawn no longer
    this.clearColumns();
    const points = layout.axes.length ? layout.orbitPoints : 0;
    this.points = new Float32Array(points * (layout.planes || []).length * 2).fill(NaN);
    this.pointEnd = 0;
  }

  clearColumns() {
    const columns = this.layout.axes.length ? this.layout.columns : 0;
    this.low = new Float32Array(columns * this.signals).fill(NaN);
    this.high = new Float32Array(columns * this.signals).fill(NaN);
    this.end = 0; // number of the column after the newest
  }

  // Takes a frame; returns whether it belongs to this layout.
  take(view) {
    const word = (index) => view.getUint32(4 * index, true);
    if (word(1) !== this.layout.epoch) return false;
    if (word(0) === SPECTRUM) {
      const none = word(2) === 0; // samples are being collected, which need be drawn once only
      if (!none || this.spectrum) this.spectrumIsNew = true;
      this.spectrum = none ? null : new Float32Array(view.buffer, SPECTRUM_HEADER);
      return true;
    }
    if (word(0) !== FRAME) return false;
    if (word(2) === this.level) this.takeColumns(view, word(3), word(4), word(5));
    this.takePoints(view, FRAME_HEADER + 8 * word(4) * word(5), word(6), word(7));
    [this.step, this.time, this.published, this.sent] = [0, 1, 2, 3].map((n) => view.getFloat64(32 + 8 * n, true));
    return true;
  }

  takeColumns(view, first, count, signals) {
    if (signals !== this.signals) return;
    const kept = this.layout.columns;
    const low = new Float32Array(view.buffer, FRAME_HEADER, count * signals);
    const high = new Float32Array(view.buffer, FRAME_HEADER + 4 * count * signals, count * signals);
    if (first !== this.end) { // columns that were left out
      this.low.fill(NaN);
      this.high.fill(NaN);
    }
    for (let n = Math.max(0, count - kept); n < count; n++) {
      const place = ((first + n) % kept) * signals;
      this.low.set(low.subarray(n * signals, (n + 1) * signals), place);
      this.high.set(high.subarray(n * signals, (n + 1) * signals), place);
    }
    this.end = first + count;
  }

  takePoints(view, at, first, count) {
    const size = 2 * this.layout.planes.length, kept = this.layout.orbitPoints;
    const points = new Float32Array(view.buffer, at, count * size);
    for (let n = Math.max(0, count - kept); n < count; n++) {
      this.points.set(points.subarray(n * size, (n + 1) * size), ((first + n) % kept) * size);
    }
    this.pointEnd = first + count;
  }

  // Smallest and largest value of a signal in the column `back` columns before the newest.
  column(back, signal) {
    const number = this.end - 1 - back;
    if (number < 0 || back >= this.layout.columns) return [NaN, NaN];
    const place = (number % this.layout.columns) * this.signals + signal;
    return [this.low[place], this.high[place]];
  }

  // Index of a signal of an axis among all signals.
  index(signal, axis) {
    return this.layout.signals.indexOf(signal) * this.layout.axes.length + axis;
  }
}
