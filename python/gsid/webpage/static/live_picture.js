// The live picture: extremes of command, rate and travel over time, and the response with its error bars.
import { byId, element } from "./elements.js";
import { drawStrips } from "./live_strips.js";

const BINS = 800; // newest ones that are shown
const SETS = 200; // that wait to be drawn: with 4 bins each, all that is shown
const DB = 20 / Math.LN10;
const LEAST = 0.05; // of the magnitude, at the lower end of a bar that would reach zero
const SIGNALS = [
  { name: "command", title: "command" },
  { name: "rate", title: "rate" },
  { name: "travel_deg", title: "travel [deg]" },
];
const CONFIG = { displayModeBar: false, responsive: true };
const FONT = { size: 10 };
const MARGIN = { l: 55, r: 10, t: 20, b: 35 };

let time = []; // end of each bin [s]
let extremes = null; // low and high of each signal and bin

export function clearPicture() {
  time = [];
  extremes = SIGNALS.map(() => ({ low: [], high: [] }));
  if (byId("live-response").data) Plotly.purge(byId("live-response"));
}

// A hidden tab draws nothing: only so many sets wait, and the last response.
export function newestOf(sets) {
  const kept = sets.slice(-SETS);
  const last = sets.findLast((one) => one.response);
  return last && !kept.includes(last) ? [{ response: last.response }, ...kept] : kept;
}

export async function drawFigures(sets) {
  for (const set of sets.filter((one) => one.t_s)) {
    time.push(...set.t_s);
    SIGNALS.forEach(({ name }, i) => {
      extremes[i].low.push(...set[name].low);
      extremes[i].high.push(...set[name].high);
    });
  }
  const extra = time.length - BINS;
  if (extra > 0) for (const list of [time, ...extremes.flatMap((one) => [one.low, one.high])]) list.splice(0, extra);
  const newest = sets.at(-1);
  showMeters(newest);
  showPeriods(newest);
  drawSignals(newest);
  const found = sets.findLast((one) => one.response)?.response;
  if (found) await drawResponse(found);
}

function drawSignals(newest) {
  const strips = SIGNALS.map(({ name, title }, i) => {
    const most = Math.max(newest.peaks[name] * 1.1, 1e-9);
    return { title, ...extremes[i], limit: newest.limits[name], most };
  });
  drawStrips(byId("live-signals"), time, strips);
}

function drawResponse(found) {
  const db = found.magnitude.map((value) => DB * Math.log(value));
  const share = found.magnitude.map((value, i) => found.std[i] / value);
  const mode = "markers";
  const marker = { size: 3, color: "#0072b2" };
  const bars = { type: "data", width: 0, thickness: 1, color: "#d55e00" };
  const up = share.map((one) => DB * Math.log(1 + one));
  const down = share.map((one) => -DB * Math.log(Math.max(1 - one, LEAST)));
  const degrees = share.map((one) => Math.min(180, (180 / Math.PI) * one));
  const traces = [
    { x: found.f_hz, y: db, error_y: { ...bars, symmetric: false, array: up, arrayminus: down }, mode, marker, name: "magnitude" },
    { x: found.f_hz, y: found.phase_deg, error_y: { ...bars, array: degrees }, yaxis: "y2", mode, marker, name: "phase" },
  ];
  const shown = found.n_lines > found.f_hz.length ? `, ${found.f_hz.length} of ${found.n_lines} lines` : "";
  const layout = {
    showlegend: false,
    font: FONT,
    margin: MARGIN,
    xaxis: { type: "log", title: { text: `frequency [Hz]; bars: one standard deviation${shown}` }, anchor: "y2" },
    yaxis: { title: { text: "magnitude [dB]" }, domain: [0.42, 1] },
    yaxis2: { title: { text: "phase [deg]" }, domain: [0, 0.37], range: [-190, 190], dtick: 90 },
  };
  return Plotly.react(byId("live-response"), traces, layout, CONFIG);
}

function showMeters(newest) {
  const meters = SIGNALS.map(({ name, title }) => {
    const [limit, peak] = [newest.limits[name], newest.peaks[name]];
    const label = element("label", `${title}: peak ${peak.toPrecision(3)} of ${limit.toPrecision(3)} `);
    label.append(element("meter", "", { min: 0, max: limit, high: 0.8 * limit, value: peak }));
    return label;
  });
  byId("live-meters").replaceChildren(...meters);
}

function showPeriods(newest) {
  const marks = newest.periods.map((good) =>
    element("span", good ? "●" : "✕", { className: good ? "good" : "spoiled", title: good ? "good period" : "spoiled period" }),
  );
  const words = `${newest.good} good, ${newest.spoiled} spoiled periods `;
  byId("live-periods").replaceChildren(words, ...marks);
}
