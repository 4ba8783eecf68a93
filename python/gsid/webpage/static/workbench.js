// The workbench: sliders and switches of the chosen model, and its output beside the record at once.
import { byId, element, isChanged, server } from "./elements.js";
import { keep, kept } from "./kept.js";
import { chosenRecords } from "./records.js";
import { act } from "./requests.js";
import { isOff, readingOf, requestStep } from "./steps.js";

const NARROW = 500; // pixels
const STEPS = 400; // of a slider
const COLOURS = { measured: "#333333", model: "#0072b2", difference: "#d55e00", noise: "#8a8a8a" };
const NAMES = { measured: "measured", model: "model", difference: "difference" };

const bench = { socket: null, model: "", sheet: [], fitted: null, values: {}, out: new Set(), added: [], serial: 0 };
let isWaiting = false; // for an answer of the server
let isMoved = false; // since the last request
let shownWindow = null; // [from, to] in s
let askedWindow = null; // of the request that is answered next
let drawnWindow = null; // of the measured output in the picture
const AXES = { y: "yaxis", y2: "yaxis2" };
const held = new Map(); // axis: its range
const zoomedAxes = new Set(); // whose range the user has chosen
const MARGIN = 0.15; // of a signal's range, above and below it
const FILLED = 0.2; // of an axis; where the signals fill less, it is made smaller

const isSame = (one, other) => JSON.stringify(one) === JSON.stringify(other);
const digits = (value, most = 4) => Number(value.toPrecision(most));
const shownModel = () => JSON.stringify([byId("model").value, byId("bench-record").value, bench.added]);
const isOpen = () => byId("workbench").open && !byId("workbench").hidden;

let recalled = kept.bench ?? null; // until it is shown once

function keepBench() {
  const { values, added } = bench;
  keep("bench", { model: byId("model").value, record: byId("bench-record").value, isOpen: isOpen(), values, added, out: [...bench.out] });
}

// Sliders and switches as they were before a reload, if they belong to what is chosen.
function recall() {
  const own = recalled;
  recalled = null;
  if (own?.model !== byId("model").value || own?.record !== byId("bench-record").value) return reset();
  Object.assign(bench, { values: own.values, added: own.added, out: new Set(own.out) });
  return renew();
}

// ---- requests: one at a time, always of the newest values --------------------------------------------

function connect() {
  bench.socket = new WebSocket(`ws://${location.host}/workbench`);
  bench.socket.addEventListener("open", () => {
    isWaiting = false;
    bench.model = "";
    send();
  });
  bench.socket.addEventListener("message", (event) => receive(JSON.parse(event.data)));
  bench.socket.addEventListener("close", () => (bench.socket = null));
}

function send() {
  isMoved = true;
  keepBench();
  if (!bench.socket) connect();
  else if (bench.socket.readyState === WebSocket.OPEN && !isWaiting) sendNow();
}

function sendNow() {
  isWaiting = true;
  isMoved = false;
  const { values, added, serial } = bench;
  const model = byId("model").value;
  const record = byId("bench-record").value;
  const sheet = shownModel() !== bench.model; // another one: its effects are needed
  askedWindow = shownWindow;
  bench.socket.send(
    JSON.stringify({
      model, record, sheet, serial, values, added, out: [...bench.out], moved: !sheet && isSame(shownWindow, drawnWindow),
      options: readingOf(), points: 2 * byId("bench-picture").clientWidth, window: shownWindow,
    }),
  );
}

function receive(answer) {
  isWaiting = false;
  if (answer.serial === bench.serial) show(answer);
  if (isMoved) sendNow();
}

// ---- what is shown -----------------------------------------------------------------------------------

function show(answer) {
  if (answer.sheet) {
    bench.model = shownModel();
    bench.fitted = answer.fitted ?? bench.fitted;
    bench.sheet = answer.sheet;
    byId("bench-effects").replaceChildren(...answer.sheet.map(effectBox));
  }
  showAnswer(answer);
  if (answer.picture) draw(answer);
}

const percent = (value) => (value === null ? "not defined" : `${digits(value)} %`);

function showAnswer(answer) {
  const line = byId("bench-answer");
  line.classList.toggle("failed", Boolean(answer.error));
  if (answer.error) {
    line.textContent = [answer.error, answer.where, answer.hint].filter(Boolean).join(" \u2013 ");
    return;
  }
  const { fitted } = bench;
  line.textContent =
    `FIT ${percent(answer.fit_percent)} (fitted values ${percent(fitted.fit_percent)}, ` +
    `noise alone ${percent(fitted.fit_percent_of_noise)}), rms error ${digits(answer.rms_error)} ${answer.unit}` +
    (answer.unsettled ? `. No steady state was found: the output changes by ${digits(answer.unsettled, 2)} ${answer.unit} from period to period` : "");
}

// Values as the server packs them: float32 in base64.
const unpack = (text) => new Float32Array(Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer);

function draw(answer) {
  const box = byId("bench-picture");
  const signals = Object.entries(answer.picture).map(([name, { x, y }]) => ({ name, x: unpack(x), y: unpack(y) }));
  if (answer.picture.measured) drawnWindow = askedWindow;
  if (box.data && !answer.sheet) {
    const columns = { x: signals.map(({ x }) => x), y: signals.map(({ y }) => y) };
    Plotly.update(box, columns, widened(signals), signals.map(({ name }) => Object.keys(NAMES).indexOf(name)));
    return;
  }
  const data = signals.map(({ name, x, y }) => ({
    x, y, name: NAMES[name], mode: "lines", yaxis: axisOf(name),
    line: { color: COLOURS[name], width: name === "measured" ? 2 : 1.2 },
  }));
  held.clear();
  zoomedAxes.clear();
  const layout = layoutOf(answer);
  for (const [name, range] of Object.entries(widened(signals))) layout[name.replace(".range", "")].range = range;
  Plotly.react(box, data, layout, { responsive: true, displaylogo: false, doubleClick: "autosize" });
  box.removeAllListeners?.("plotly_relayout");
  box.on("plotly_relayout", zoomed);
}

const axisOf = (name) => (name === "difference" ? "y2" : "y");

// Ranges of the axes that the signals leave, or of which they fill little: an axis that stays is drawn faster.
function widened(signals) {
  const changes = {};
  for (const axis of Object.keys(AXES).filter((one) => !zoomedAxes.has(one))) {
    const own = signals.filter(({ name }) => axisOf(name) === axis).map(({ y }) => extent(y));
    const low = Math.min(...own.map(([least]) => least));
    const high = Math.max(...own.map(([, most]) => most));
    const [least, most] = held.get(axis) ?? [0, 0];
    const isFilled = high - low >= FILLED * (most - least);
    if (low >= least && high <= most && isFilled) continue;
    const margin = MARGIN * (high - low || Math.abs(high) || 1);
    held.set(axis, [low - margin, high + margin]);
    changes[`${AXES[axis]}.range`] = held.get(axis);
  }
  return changes;
}

function extent(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

function layoutOf(answer) {
  const bound = answer.noise_of_mean;
  const isNarrow = byId("bench-picture").clientWidth < NARROW;
  const unit = answer.unit ? ` [${answer.unit}]` : "";
  return {
    autosize: true, font: { size: isNarrow ? 9 : 11 }, margin: { l: isNarrow ? 44 : 62, r: 8, t: 26, b: 36 }, uirevision: bench.model,
    legend: { orientation: "h", x: 0, y: 1, yanchor: "bottom" },
    xaxis: { title: { text: "time in the period [s]" }, anchor: "y2" },
    yaxis: { title: { text: `output${unit}` }, domain: [0.42, 1] },
    yaxis2: { title: { text: `difference${unit}` }, domain: [0, 0.36] },
    shapes: [
      { type: "rect", xref: "paper", x0: 0, x1: 1, yref: "y2", y0: -bound, y1: bound, fillcolor: COLOURS.noise, opacity: 0.3, line: { width: 0 } },
    ],
  };
}

// A part of the picture is drawn with points of its own.
function zoomed(change) {
  for (const [axis, name] of Object.entries(AXES)) {
    if (change[`${name}.autorange`]) {
      zoomedAxes.delete(axis);
      held.delete(axis);
    } else if (change[`${name}.range[0]`] !== undefined) zoomedAxes.add(axis);
  }
  if (change["xaxis.autorange"]) shownWindow = null;
  else if (change["xaxis.range[0]"] !== undefined) shownWindow = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
  else return;
  send();
}

// ---- effects -----------------------------------------------------------------------------------------

function effectBox(effect) {
  const box = element("fieldset", "", { title: effect.sentence });
  const legend = element("legend");
  if (effect.may_be_out) {
    const label = element("label");
    const inside = element("input", "", { type: "checkbox", checked: !bench.out.has(effect.label), name: effect.label });
    inside.setAttribute("role", "switch");
    inside.addEventListener("change", () => {
      if (inside.checked) bench.out.delete(effect.label);
      else bench.out.add(effect.label);
      box.classList.toggle("out", !inside.checked);
      send();
    });
    label.append(inside, ` ${effect.label}`);
    legend.append(label);
  } else legend.textContent = effect.label;
  box.classList.toggle("out", bench.out.has(effect.label));
  box.append(legend, element("p", effect.sentence, { className: "sentence" }));
  box.append(...effect.parameters.map((known) => valueBox(known, effect.added)));
  return box;
}

function valueBox(known, isAdded) {
  const box = element("div", "", { className: "value" });
  const name = `${known.name.replace(/\..*/, "")} ${known.words}`;
  const slider = element("input", "", { type: "range", min: 0, max: STEPS, step: 1, name: known.name });
  slider.setAttribute("aria-label", `${name}, slider`);
  const field = element("input", "", { type: "number", step: "any", min: known.least, max: known.most });
  field.setAttribute("aria-label", known.unit ? `${name} [${known.unit}]` : name);
  const shown = (value) => {
    slider.value = placeOf(known, value);
    slider.setAttribute("aria-valuetext", `${digits(value)} ${known.unit}`);
  };
  const now = bench.values[known.name] ?? known.value;
  field.value = digits(now, 6);
  shown(now);
  slider.addEventListener("input", () => {
    const value = digits(valueAt(known, Number(slider.value)));
    field.value = value;
    shown(value);
    bench.values[known.name] = value;
    send();
  });
  field.addEventListener("input", () => {
    if (field.value === "" || !field.validity.valid) return;
    bench.values[known.name] = Number(field.value);
    shown(Number(field.value));
    send();
  });
  const row = element("div", "", { className: "row" });
  row.append(element("label", known.words), field, element("span", known.unit || "1", { className: "unit" }));
  box.append(row, slider);
  if (!isAdded) box.append(markOf(known), element("div", fittedWords(known), { className: "fitted" }));
  return box;
}

function fittedWords(known) {
  const own = known.free ? "fitted" : "fixed at";
  const interval = known.half_interval === null ? "" : ` \u00b1 ${digits(known.half_interval, 2)}`;
  return `${own} ${digits(known.value)}${interval} ${known.unit}${interval && " (95 %)"}`;
}

function markOf(known) {
  const mark = element("div", "", { className: "mark" });
  const share = (value) => Math.min(Math.max(placeOf(known, value) / STEPS, 0), 1);
  if (known.half_interval !== null) {
    const [low, high] = [share(known.value - known.half_interval), share(known.value + known.half_interval)];
    const band = element("i");
    Object.assign(band.style, { left: `${100 * low}%`, width: `${100 * (high - low)}%` });
    mark.append(band);
  }
  const line = element("b");
  line.style.left = `${100 * share(known.value)}%`;
  mark.append(line);
  return mark;
}

// The first step of a logarithmic slider is 0 where the effect may vanish.
function valueAt(known, place) {
  if (!known.is_log) return known.low + ((known.high - known.low) * place) / STEPS;
  if (known.has_zero && place === 0) return 0;
  return known.low * (known.high / known.low) ** (place / STEPS);
}

function placeOf(known, value) {
  if (!known.is_log) return (STEPS * (value - known.low)) / (known.high - known.low);
  if (value <= 0) return 0;
  return Math.max((STEPS * Math.log(value / known.low)) / Math.log(known.high / known.low), known.has_zero ? 1 : 0);
}

// ---- the part of the page ----------------------------------------------------------------------------

// Shows the effects again, with those that were added; all values stay.
function renew() {
  bench.model = "";
  bench.serial += 1; // answers for what was before are not shown
  send();
}

function reset() {
  bench.values = {};
  bench.added = [];
  bench.out.clear();
  renew();
}

export function showWorkbench() {
  byId("workbench").hidden = !server.state.models.length || !server.state.records.length;
  const records = chosenRecords();
  if (isChanged("workbench records", records)) {
    const select = byId("bench-record");
    const chosen = select.value;
    select.replaceChildren(...records.map((name) => element("option", name.replace("records/", ""), { value: name })));
    if (records.includes(chosen)) select.value = chosen;
    else if (records.includes(recalled?.record)) select.value = recalled.record;
    if (recalled?.isOpen) byId("workbench").open = true;
  }
  followChoice();
}

function followChoice() {
  const now = [byId("model").value, byId("bench-record").value, readingOf(), isOpen()];
  if (!isChanged("workbench model", now) || !isOpen()) return;
  if (!byId("model").value || !byId("bench-record").value) {
    showAnswer({ error: "Choose a model and tick a record." });
    return;
  }
  shownWindow = null;
  if (recalled) recall();
  else reset();
}

function addEffect(event) {
  if (!event.target.value) return;
  bench.added.push({ effect: event.target.value });
  event.target.value = "";
  renew();
}

function fit() {
  const edit = { values: bench.values, out: [...bench.out], added: bench.added };
  return requestStep({ edit });
}

// ---- a law that is typed: checked by the server's parser, never run -----------------------------------

let law = null; // as it was checked
let lawNumber = 0;

async function checkLaw() {
  lawNumber += 1;
  const own = lawNumber;
  const text = byId("law").value.trim();
  law = null;
  if (text) {
    const answer = await fetch("/law", { method: "POST", body: JSON.stringify({ law: text }) }).catch(() => null);
    const found = await answer?.json().catch(() => null);
    if (own !== lawNumber) return; // the text has changed since
    showLaw(found ?? { error: "no connection to gsid studio" });
    if (found?.params) law = found;
  } else showLaw(null);
  byId("law-add").setAttribute("aria-disabled", String(!law));
}

function showLaw(found) {
  const box = byId("law-answer");
  box.classList.toggle("failed", Boolean(found?.error));
  if (!found) box.textContent = "";
  else if (found.error) box.textContent = [found.error, found.where, found.hint].filter(Boolean).join("\n");
  else box.textContent = `A law with ${Object.keys(found.params).join(", ") || "no parameters"}.`;
}

function addLaw() {
  bench.added.push(law);
  byId("law").value = "";
  checkLaw();
  renew();
}

byId("workbench").addEventListener("toggle", () => {
  followChoice();
  if (!recalled) keepBench();
});
for (const part of ["model", "records", "reading", "bench-record"]) byId(part).addEventListener("change", () => server.state && followChoice());
byId("bench-form").addEventListener("submit", (event) => event.preventDefault());
byId("bench-reset").addEventListener("click", reset);
byId("bench-add").addEventListener("change", addEffect);
byId("bench-fit").addEventListener("click", (event) => isOff(event.target) || act(fit));
byId("law").addEventListener("input", checkLaw);
byId("law-add").addEventListener("click", (event) => isOff(event.target) || addLaw());
