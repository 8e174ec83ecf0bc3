// Log, trips, nodes and model. Texts of the graph are shown as text, whatever they contain.

import { element } from "./regions.js";
import { short } from "./drawing.js";

const KEPT_LINES = 300;

const clock = (at) => new Date(1000 * at).toTimeString().slice(0, 8);

export function addLines(list, lines) {
  const atEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 8;
  for (const line of lines) {
    const item = element("li", {},
      element("time", { textContent: clock(line.at) }), element("span", { className: "name", textContent: line.name }),
      element("span", { className: "text", textContent: line.text }));
    item.dataset.level = line.level;
    list.append(item);
  }
  while (list.children.length > KEPT_LINES) list.firstElementChild.remove();
  if (atEnd) list.scrollTop = list.scrollHeight;
}

export function showTrips(list, trips) {
  list.previousElementSibling.hidden = trips.length > 0;
  list.replaceChildren(...[...trips].reverse().map((trip) =>
    element("li", { textContent: `${clock(trip.at)} ${trip.text} (step ${trip.step})` })));
}

export function showNodes(list, nodes) {
  const entries = Object.entries(nodes);
  list.previousElementSibling.hidden = entries.length > 0;
  list.replaceChildren(...entries.map(([name, { level, message, away }]) => {
    const dot = element("span", { className: "dot", title: away ? "away" : level });
    dot.dataset.level = away ? "stale" : level;
    const text = element("span", { className: "message", textContent: away ? "away" : message });
    const item = element("li", {}, dot, element("span", {}, element("span", { textContent: `${name} ` }), text));
    item.classList.toggle("away", away);
    return item;
  }));
}

export function showModel(list, model) {
  const fit = model.outputs.map((name, n) => (model.fit[n] === undefined ? "" : `${name} ${short(model.fit[n])} %`)).filter(Boolean);
  const rows = [["model", `order ${model.order} by ${model.method}`], ["unstable poles", `${model.unstable}`], ["data", model.source]];
  if (fit.length) rows.splice(1, 0, ["fit", fit.join(", ")]);
  list.replaceChildren(...rows.flatMap(([name, text]) => [element("dt", { textContent: name }), element("dd", { textContent: text })]));
  list.hidden = false;
}
