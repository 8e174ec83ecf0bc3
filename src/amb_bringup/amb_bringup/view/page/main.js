// The live page: takes what the server pushes, and draws it once per frame of the screen.

import { Connection } from "./connection.js";
import { readColours, seconds, short } from "./drawing.js";
import { addLines, showModel, showNodes, showTrips } from "./lists.js";
import { drawMap, noteRegion } from "./map.js";
import { drawOrbits, makeOrbits } from "./orbits.js";
import { Orders } from "./orders.js";
import { atRest, isOver, outdatedBecause, showRegions } from "./regions.js";
import { Samples } from "./samples.js";
import { drawSpectrum } from "./spectrum.js";
import { drawStrips } from "./strips.js";

const SILENCE = 1000; // ms without frames after which the loop counts as standing
const find = (id) => document.getElementById(id);
const samples = new Samples();
const state = { connected: false, closing: "", sections: {}, frozen: false, whole: false, waiting: false };
// For programs that measure the page: frames drawn, time that took, and how old the newest
// drawn sample was (ms).
const measured = { drawn: 0, drawing: 0, step: 0, ages: [] };
globalThis.ambView = { measured, state, samples };

let lastFrame = -Infinity, drawnBefore = 0, behind = 0;
const connection = new Connection(take, onConnection);
const orders = new Orders((message) => connection.send(message));

function take(message) {
  if (message instanceof DataView) {
    if (state.frozen || !samples.take(message) || message.getUint32(0, true) !== 1) return;
    lastFrame = performance.now();
    if (!state.waiting) requestAnimationFrame(draw);
    state.waiting = true;
  } else if (message.type === "state") show(message);
  else if (message.type === "hello") orders.greet(message);
  else if (message.type === "unlocked") orders.unlock();
  else if (message.type === "answer") orders.answer(message);
  else if (message.type === "problem") {
    sessionStorage.removeItem("token");
    find("answer").textContent = message.text;
    find("answer").dataset.ok = false;
  }
}

function onConnection(connected, reason = "") {
  Object.assign(state, { connected, closing: reason });
  if (connected) {
    samples.use({ epoch: -1, axes: [] });
    find("log-list").replaceChildren();
    connection.send({ do: "window", level: samples.level });
  }
  showStatus();
}

const SHOW = {
  layout: (layout) => {
    samples.use(layout);
    makeOrbits(find("orbit-grid"), layout);
    find("orbits").querySelector(".empty").hidden = (layout.planes || []).length > 0;
    showWindows(layout);
  },
  machine: (machine) => {
    const bearings = machine.bearings.length === 1 ? "1 bearing" : `${machine.bearings.length} bearings`;
    const what = `${machine.axes.map((axis) => axis.name).join(", ")} in ${bearings}`;
    find("machine").textContent = `${machine.name} (${machine.source}): ${what}, ${+(machine.sampleRate / 1000).toPrecision(4)} kHz`;
  },
  region: noteRegion,
  plant: (plant) => orders.usePlant(plant),
  model: (model) => showModel(find("model"), model),
  trips: (trips) => showTrips(find("trip-list"), trips),
  nodes: (nodes) => showNodes(find("node-list"), nodes),
};

function show({ sections, log }) {
  Object.assign(state.sections, sections);
  for (const [name, value] of Object.entries(sections)) SHOW[name]?.(value);
  if (sections.region || sections.plant || sections.away) {
    showRegions(find("lamps"), state.sections.region, outdatedBecause(state.sections));
  }
  if (sections.map || sections.region || sections.plant || sections.away) showMap();
  if (log.length) addLines(find("log-list"), log);
  showStatus();
}

// Whether the node that reports a section is away: the section then holds its last values.
function isAway(section) {
  return (state.sections.away || []).includes(section);
}

function showMap() {
  const present = !isAway("region") && !isAway("plant") && !isOver(state.sections);
  drawMap(find("plane"), state.sections.map, present ? state.sections.region : null);
}

function showWindows(layout) {
  if (!layout.axes.length) return;
  const names = layout.columnTimes.map((time) => seconds(time * layout.columns));
  find("window").replaceChildren(...names.map((name, level) => new Option(name, level, false, level === samples.level)));
}

function showStatus() {
  const { graph, plant, map } = state.sections;
  let kind = "live", text = plant ? `${plant.what} ${plant.mode}` : "live", banner = plant?.problem || "";
  if (!state.connected) {
    [kind, text, banner] = ["away", "no server", `No connection to the server${state.closing ? ` (${state.closing})` : ""}; trying again.`];
  } else if (!graph?.alive) {
    kind = "away";
    text = graph?.known ? "graph away" : "no graph yet";
    banner = graph?.known ? "The graph is away: none of its nodes reports. What is shown is the last of it; the page goes on when it is back."
      : "No graph in this DDS domain yet: start one with amb up or amb rig up.";
  } else if (isAway("plant")) {
    [kind, text] = ["away", `${plant.what} away`];
    banner = `The ${plant.what} is away: it no longer reports. What is shown of it is the last; what it does now is not known.`;
  } else if (performance.now() - lastFrame > SILENCE) kind = "idle";
  find("dot").dataset.state = kind;
  find("status-text").textContent = text;
  find("banner").textContent = banner;
  find("banner").hidden = !banner;
  const factor = graph?.sampleRate && graph.rate ? ` (${(graph.rate / graph.sampleRate).toPrecision(2)} × real time)` : "";
  find("speed").textContent = graph ? `${Math.round(graph.rate)} steps/s${factor}` : "–";
  find("map-text").textContent = map ? "Region map with the operating point of each axis."
    : "No region map: start the page with --map, or build one with the action build_map.";
  showExcitation();
}

function showExcitation() {
  const excitation = state.sections.excitation;
  if (!excitation) return;
  const left = (excitation.first + excitation.steps - samples.step) * (samples.layout.sampleTime || 0);
  let text = `Excitation refused: ${excitation.message}`;
  if (excitation.accepted) {
    const ended = excitation.kind === "stop" || left <= 0 || excitation.run !== samples.layout.run || atRest(state.sections.plant);
    text = ended ? "No excitation." : `Excitation: ${excitation.kind}, ${short(left)} s left.`;
  }
  if (isAway("excitation") || isAway("plant")) text = "Excitation not known: its node is away.";
  if (find("excitation").textContent !== text) find("excitation").textContent = text;
}

function draw() {
  state.waiting = false;
  const begin = performance.now();
  drawStrips(find("strips"), samples, find("signal").value);
  drawOrbits(find("orbit-grid"), samples, state.whole);
  if (samples.spectrumIsNew) drawSpectrum(find("lines"), samples);
  samples.spectrumIsNew = false;
  measured.drawn += 1;
  measured.drawing += performance.now() - begin;
  measured.step = samples.step;
  measured.ages.push(performance.timeOrigin + performance.now() - 1000 * samples.published);
  if (measured.ages.length > 2000) measured.ages.splice(0, 1000);
  // Without a common clock: age when the server sent it, and half the time to the server and back.
  behind = 1000 * (samples.sent - samples.published) + connection.roundTrip / 2;
}

function everySecond() {
  const drawing = performance.now() - lastFrame < SILENCE;
  find("rate").textContent = drawing ? `${measured.drawn - drawnBefore}/s` : "–";
  drawnBefore = measured.drawn;
  find("behind").textContent = drawing ? `${Math.round(behind)} ms` : "–";
  find("run-time").textContent = `${samples.time.toFixed(2)} s`;
  find("run-step").textContent = `${samples.step}`;
  showStatus();
}

function redraw() {
  readColours();
  if (samples.layout.axes.length) draw();
  drawSpectrum(find("lines"), samples);
  showMap();
}

function chooseWindow(level) {
  if (!samples.layout.axes.length || level >= samples.layout.columnTimes.length) return;
  samples.level = level;
  samples.clearColumns();
  find("window").value = level;
  connection.send({ do: "window", level });
}

function toggle(button, name) {
  state[name] = !state[name];
  find(button).setAttribute("aria-pressed", state[name]);
  if (!state.frozen && name === "frozen") chooseWindow(samples.level); // what was missed meanwhile
  else redraw();
}

const KEYS = {
  " ": () => toggle("freeze", "frozen"),
  z: () => toggle("zoom", "whole"),
  s: () => {
    find("signal").selectedIndex = 1 - find("signal").selectedIndex;
    redraw();
  },
  Escape: () => orders.order("stop_excitation", {}),
};

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const typing = event.target.matches("input, select, textarea") || (event.key === " " && event.target.matches("button, summary, a"));
  if (typing && event.key !== "Escape") return;
  const act = /^[1-5]$/.test(event.key) ? () => chooseWindow(Number(event.key) - 1) : KEYS[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});
find("freeze").addEventListener("click", KEYS[" "]);
find("zoom").addEventListener("click", KEYS.z);
find("signal").addEventListener("change", redraw);
find("window").addEventListener("change", (event) => chooseWindow(Number(event.target.value)));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
addEventListener("resize", redraw);
setInterval(everySecond, 1000);
redraw();
showStatus();
