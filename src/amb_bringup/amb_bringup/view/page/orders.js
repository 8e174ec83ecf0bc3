// Orders to the graph, for pages that were opened with the token.

import { element } from "./regions.js";

const MAIN = ["amplitude", "frequency", "frequency_start", "frequency_end", "duration", "axes", "frequencies", "amplitudes"];
const PLANT = {
  simulator: [["run", "Run"], ["pause", "Pause"], ["reset", "Reset"]],
  rig: [["levitate", "Levitate"], ["land", "Land"], ["off", "Off"], ["reset_trip", "Reset trip"]],
};
const KEPT_ENDS = 3; // of earlier orders
const MICRO = "m"; // fields in metres are shown in micrometres

const find = (id) => document.getElementById(id);

export class Orders {
  constructor(send) {
    this.send = send;
    this.number = 0;
    this.plant = "";
    this.names = new Map(); // of orders without a final answer, by number
    this.unlocked = false;
    this.token = takeToken();
    find("kind").addEventListener("change", () => this.showSettings());
    find("excite").addEventListener("submit", (event) => this.submit(event, () => this.excite()));
    find("identify").addEventListener("submit", (event) => this.submit(event, () => this.order("identify", identification())));
    find("orders").addEventListener("click", (event) => {
      const order = event.target.closest("button")?.dataset.order;
      if (order) this.order(order, order === "run" ? { real_time: find("real-time").checked } : {});
    });
  }

  // The server has been reached: what it offers, and whether it takes orders.
  greet(hello) {
    this.unlocked = false;
    this.forms = hello.forms;
    const kind = find("kind"), chosen = kind.value;
    kind.replaceChildren(...Object.keys(hello.forms.excitations).map((name) => element("option", { textContent: name })));
    if (chosen) kind.value = chosen;
    else this.showSettings();
    const methods = hello.forms.methods.map((name) => element("option", { textContent: name }));
    find("method").replaceChildren(element("option", { value: "", textContent: "default" }), ...methods);
    this.lock(hello.readOnly ? "Read-only: the server takes no orders."
      : "Read-only: open the address with the token, which the terminal of amb view shows.");
    if (this.token && !hello.readOnly) this.send({ do: "unlock", token: this.token });
  }

  lock(text) {
    find("lock").textContent = text;
    find("lock").hidden = !text;
    find("controls").disabled = Boolean(text);
  }

  unlock() {
    this.unlocked = true;
    this.lock("");
  }

  usePlant({ what, tripped }) {
    this.showButtons(what);
    const reset = find("plant-orders").querySelector("[data-order=reset_trip]");
    if (reset) reset.hidden = !tripped;
  }

  showButtons(what) {
    if (what === this.plant) return;
    this.plant = what;
    find("plant-orders").replaceChildren(...(PLANT[what] || []).map(([order, textContent]) => {
      const button = element("button", { type: "button", textContent });
      button.dataset.order = order;
      if (order === "off") Object.assign(button, { className: "stop", title: "Switches the currents off at once: the rotor falls" });
      return button;
    }));
    find("real-time").parentElement.hidden = what !== "simulator";
  }

  submit(event, act) {
    event.preventDefault();
    act();
  }

  order(order, settings) {
    if (!this.unlocked) return;
    this.number += 1;
    this.names.set(this.number, order.replaceAll("_", " "));
    this.send({ do: "order", order, settings, number: this.number });
    this.answer({ ok: true, text: `${order.replace("_", " ")} …`, number: this.number });
  }

  // The answer of the newest order, and below it how earlier ones have ended since.
  answer({ ok, text, number, final }) {
    const name = this.names.get(number);
    if (final) this.names.delete(number);
    if (number < this.number) {
      if (final) this.addEnd(`${name || "an earlier order"}: ${text}`, ok);
      return;
    }
    const shown = find("answer");
    shown.textContent = text;
    shown.dataset.ok = ok;
  }

  addEnd(textContent, ok) {
    const item = element("li", { textContent });
    item.dataset.ok = ok;
    find("ends").prepend(item);
    while (find("ends").children.length > KEPT_ENDS) find("ends").lastElementChild.remove();
  }

  showSettings() {
    const fields = this.forms.excitations[find("kind").value] || [];
    const shown = (chosen) => fields.filter((field) => MAIN.includes(field.name) === chosen).map(fieldElement);
    find("settings").replaceChildren(...shown(true));
    find("more-settings").replaceChildren(...shown(false));
  }

  // A wrong field is named as the page shows it, before anything is sent.
  excite() {
    for (const input of find("excite").querySelectorAll("[data-name]")) {
      const text = this.unlocked ? wrongIn(input) : "";
      if (!text) continue;
      this.number += 1;
      this.answer({ ok: false, text, number: this.number });
      input.closest("details")?.setAttribute("open", "");
      input.focus();
      return;
    }
    this.order("start_excitation", this.settings());
  }

  settings() {
    const settings = { kind: find("kind").value };
    for (const input of find("excite").querySelectorAll("[data-name]")) {
      const value = valueOf(input);
      if (value !== undefined) settings[input.dataset.name] = value;
    }
    return settings;
  }
}

// The token in the address, which is then removed from what the address bar and the history show.
function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem("token", given);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem("token");
}

function fieldElement(field) {
  const inMicro = field.unit === MICRO, unit = inMicro ? "µm" : field.unit === "-" ? "" : field.unit;
  const scale = inMicro ? 1e-6 : 1, bound = (value) => (value === null ? "" : +(value / scale).toPrecision(6));
  let input;
  if (field.choices.length) {
    input = element("select", {}, ...field.choices.map((name) => element("option", { textContent: name })));
    if (field.default) input.value = field.default;
  } else if (field.type === "bool") input = element("input", { type: "checkbox", checked: field.default === true });
  else {
    const missing = field.type === "list" ? "" : "required";
    const shown = field.default === null ? missing : inMicro ? +(1e6 * field.default).toPrecision(6) : field.default;
    input = element("input", { type: "text", placeholder: shown, inputMode: field.type === "str" ? "text" : "decimal" });
  }
  Object.assign(input.dataset, { name: field.name, type: field.type, scale, unit, least: bound(field.minimum), most: bound(field.maximum) });
  input.title = allowedIn(input) ? `${field.description}; allowed: ${allowedIn(input)}` : field.description;
  const text = field.name.replaceAll("_", " ") + (unit ? ` (${unit})` : "");
  return element("label", {}, text, input);
}

function allowedIn({ dataset: { least, most, unit } }) {
  const range = least && most ? `${least} to ${most}` : least ? `from ${least} on` : most ? `up to ${most}` : "";
  return range && `${range} ${unit}`.trim();
}

// What is wrong with a number that a field holds; empty if nothing is.
function wrongIn(input) {
  const { name, type, unit, least, most } = input.dataset, text = input.value.trim(), shown = name.replaceAll("_", " ");
  if (type !== "float" && type !== "int") return "";
  if (!text) return input.placeholder === "required" ? `${shown} is missing; allowed: ${allowedIn(input)}` : "";
  const value = Number(text);
  if (Number.isFinite(value) && !(least && value < Number(least)) && !(most && value > Number(most))) return "";
  return `${shown} = ${text} ${unit} is not allowed; allowed: ${allowedIn(input) || "a number"}`.replace("  ", " ");
}

// What a field sets; undefined for the default. What is no number goes to the server, which refuses it by name.
function valueOf(input) {
  if (input.type === "checkbox") return input.checked || undefined;
  const text = input.value.trim();
  if (!text) return undefined;
  const number = (part) => (Number.isFinite(Number(part)) && part.trim() ? Number(part) * Number(input.dataset.scale) : part);
  if (input.dataset.type === "list") return text.split(",").map(number);
  return input.dataset.type === "str" ? text : number(text);
}

function identification() {
  const order = find("order").value.trim();
  return { order: order === "" ? 0 : /^[0-9]+$/.test(order) ? Number(order) : order, method: find("method").value };
}
