// The lamp of each axis: its region, and the evidence for it.

import { hertz, micro, percent, short } from "./drawing.js";

const MEANINGS = { A: "steady bias", B: "drifting bias", C: "slow oscillation", D: "delevitated" };

export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// Why an axis shows no region; empty if it does. A says that B, C and D were looked for.
function unjudgedBecause(axis, settled) {
  if (axis.frozen) return "sensor stands still";
  if (axis.region !== "A" || !settled || !axis.not_judged) return "";
  return `none found, ${[...axis.not_judged].join(" and ")} not judged`;
}

// Why nothing is excited or judged now; empty while the rotor is levitated.
export function atRest(plant) {
  return plant?.what === "rig" && plant.mode !== "levitated" ? plant.mode : "";
}

// Whether the run of the last regions is over: the plant has begun a later one.
export function isOver({ region, plant }) {
  return Boolean(region && plant && plant.run > region.run);
}

// Why the last regions hold no longer; empty while they do.
export function outdatedBecause({ region, plant, away = [] }) {
  if (away.includes("region")) return "region monitor away";
  if (away.includes("plant")) return `${plant.what} away`;
  return atRest(plant) || (isOver({ region, plant }) ? "new run" : "");
}

// The lamps; `away` says why the last regions hold no longer, and is empty while they do.
export function showRegions(list, region, away = "") {
  list.previousElementSibling.hidden = Boolean(region);
  if (!region) return;
  while (list.children.length > region.axes.length) list.lastElementChild.remove();
  region.axes.forEach((axis, number) => {
    const item = list.children[number] || list.appendChild(newLamp());
    const [lamp, name, evidence] = item.children;
    const unjudged = away || unjudgedBecause(axis, region.settled);
    lamp.textContent = unjudged ? "–" : axis.region;
    lamp.dataset.region = unjudged ? "none" : axis.region;
    const early = axis.region === "A" && !region.settled; // delevitation is seen at once
    lamp.dataset.settled = !early;
    name.firstChild.textContent = axis.name;
    name.lastChild.textContent = ` ${unjudged || MEANINGS[axis.region] + (early ? ", too early for B and C" : "")}`;
    const text = away || axis.frozen ? "" : evidenceOf(axis).join(" · ");
    if (evidence.textContent !== text) evidence.textContent = text;
  });
}

function newLamp() {
  const name = element("span", { className: "axis" }, document.createTextNode(""), element("span"));
  return element("li", {}, element("span", { className: "lamp" }), name, element("span", { className: "evidence" }));
}

function evidenceOf(axis) {
  const evidence = [`bias ${micro(axis.bias)}`];
  if (axis.drifting) evidence.push(`drifts by ${short(axis.trend * 1e6)} µm/s`);
  const [slow, slowFrequency] = axis.oscillation;
  if (axis.oscillating || slow > 1e-7) evidence.push(`slow line ${micro(slow)} at ${hertz(slowFrequency)}`);
  const [amplitude, frequency] = axis.input;
  if (amplitude > 0) evidence.push(`input ${micro(amplitude)} at ${hertz(frequency)}`);
  if (axis.response > 0) evidence.push(`response ${micro(axis.response)}`);
  if (axis.even !== null) evidence.push(`distortion even ${percent(axis.even)}, odd ${percent(axis.odd)}`);
  if (axis.steady[0] > 0) evidence.push(`steady line ${micro(axis.steady[0])} at ${hertz(axis.steady[1])}`);
  if (axis.resonance) evidence.push("at its resonance");
  if (axis.beat) evidence.push("beats with the sample rate");
  return evidence;
}
