// Other studies beside this one, and the responses of several records in one picture.
import { byId, element, whenOpen } from "./elements.js";
import { drawPicture } from "./picture.js";
import { chosenRecords } from "./records.js";
import { act, answerOf, post } from "./requests.js";

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const NARROW = 600; // pixels
const FEW = 3; // standard deviations
const digits = (value, most = 4) => String(Number(value.toPrecision(most)));

// ---- which studies -----------------------------------------------------------------------------------

async function list() {
  const answer = await answerOf("/studies");
  if (!answer?.ok) return;
  const { studies } = await answer.json();
  byId("studies").replaceChildren(...studies.map(studyItem));
  if (!studies.length) byId("studies").append(element("li", "No other study is in the folder beside this one."));
  byId("studies-compare").hidden = !studies.length;
}

function studyItem({ name, named }) {
  const label = element("label");
  label.append(element("input", "", { type: "checkbox", value: name, checked: named }), ` ${name}`);
  const item = element("li");
  item.append(label);
  return item;
}

const ticked = () => [...byId("studies").querySelectorAll("input:checked")].map((one) => one.value);

async function compareStudies() {
  const names = ticked();
  const found = await post("/studies/compare", JSON.stringify({ names }));
  if (!found) return;
  open("Studies beside each other");
  showTable(found);
  drawCurves(found.curves);
  byId("comparison-steps").replaceChildren(...names.map(stepsOf));
}

async function compareRecords() {
  const found = await post("/responses", JSON.stringify({ records: chosenRecords() }));
  if (!found) return;
  open("Measured responses of the ticked records");
  byId("comparison-table").replaceChildren();
  byId("comparison-steps").replaceChildren();
  drawCurves(found.curves);
}

function open(title) {
  byId("comparison").hidden = false;
  byId("comparison-title").textContent = title;
  byId("comparison").focus();
}

// ---- table -------------------------------------------------------------------------------------------

function rowOf(title, cells, tag = "td") {
  const row = element("tr");
  row.append(element("th", title, { scope: "row" }), ...cells.map((cell) => (cell instanceof Node ? cell : element(tag, cell))));
  return row;
}

function showTable({ studies, rows }) {
  const own = (text) => studies.map(text);
  byId("comparison-table").replaceChildren(
    rowOf("Study", own((one) => one.name), "th"),
    rowOf("Verdict", own((one) => one.verdict || "not judged yet")),
    rowOf("Model", own((one) => one.model.replace("models/", "") || "none")),
    rowOf("FIT", own((one) => (one.fit_percent === null ? "not known" : `${digits(one.fit_percent)} %`))),
    rowOf("Cost (1: noise alone)", own((one) => (one.cost == null ? "not fitted" : digits(one.cost)))),
    ...rows.map(({ name, cells }) => rowOf(name.replace(/[_.]/g, " ").replace(/ (s|hz|deg|rad)$/, ""), cells.map(valueCell))),
    ...(studies.some((one) => one.note) ? [rowOf("Note", own((one) => one.note))] : []),
  );
}

// A value with its uncertainty, and its difference to the first study.
function valueCell(cell) {
  if (!cell) return element("td", "\u2013");
  const std = cell.std === null ? "" : ` \u00b1 ${digits(cell.std, 2)}`;
  const made = element("td", `${digits(cell.value)}${std} ${cell.unit === "1" ? "" : cell.unit}`.trim());
  if (cell.differs_sd === null) return made;
  const size = Math.abs(cell.differs_sd);
  made.append(element("small", `${cell.differs_sd < 0 ? "\u2212" : "+"}${digits(size, 2)} standard deviations`, { className: size > FEW ? "apart" : "" }));
  return made;
}

// ---- picture -----------------------------------------------------------------------------------------

function drawCurves(curves) {
  const box = byId("comparison-picture");
  box.hidden = !curves.length;
  if (!curves.length) return;
  const data = curves.flatMap((curve, number) => tracesOf(curve, COLOURS[number % COLOURS.length]));
  const units = [...new Set(curves.map(({ unit }) => unit).filter(Boolean))].join(", ");
  const narrow = box.clientWidth < NARROW;
  const layout = {
    autosize: true, font: { size: narrow ? 9 : 11 }, margin: { l: narrow ? 44 : 62, r: 8, t: 8, b: 40 },
    legend: { orientation: "h", x: 0, y: -0.12, yanchor: "top" },
    xaxis: { type: "log", title: { text: "f [Hz]" }, anchor: "y2" },
    yaxis: { title: { text: `|G| [dB${units && ` of ${units}`}]` }, domain: [0.42, 1] },
    yaxis2: { title: { text: "phase [deg]" }, domain: [0, 0.36], dtick: 90, range: [-190, 190] },
  };
  Plotly.react(box, data, layout, { responsive: true, displaylogo: false });
}

function tracesOf(curve, color) {
  const both = (part, name, how) => [
    { x: curve.f_hz, y: curve[part].db, name, legendgroup: name, ...how },
    { x: curve.f_hz, y: curve[part].deg, name, legendgroup: name, showlegend: false, yaxis: "y2", ...how },
  ];
  const measured = both("measured", `${curve.name} measured`, { mode: "markers", marker: { color, size: 4, opacity: 0.6 } });
  if (!curve.model.db.length) return measured;
  return [...measured, ...both("model", `${curve.name} model`, { mode: "lines", line: { color, width: 1.5 } })];
}

// ---- what another study did, to be read only -------------------------------------------------------------

function stepsOf(name) {
  const box = element("details");
  box.append(element("summary", `Steps of ${name}`));
  box.addEventListener("toggle", () => box.open && box.children.length === 1 && showSteps(box, name));
  return box;
}

async function showSteps(box, name) {
  const list = element("ol");
  box.append(list);
  const answer = await answerOf(`/studies/steps?name=${encodeURIComponent(name)}`);
  if (!answer?.ok) return box.append(element("p", "The study cannot be read."));
  const { steps } = await answer.json();
  if (!steps.length) box.append(element("p", "It has no steps yet."));
  for (const step of steps) {
    const item = element("li");
    list.append(item);
    item.append(element("h4", step.title), element("p", step.words[0] ?? ""), element("code", step.command));
    if (!step.picture) continue;
    const picture = element("div", "", { className: "picture" });
    item.append(picture);
    const address = `/studies/file?name=${encodeURIComponent(name)}&path=${encodeURIComponent(step.picture)}`;
    drawPicture(picture, address, `${step.title}: ${step.words[0] ?? ""}`).catch(() => (picture.textContent = "The picture could not be drawn."));
  }
}

whenOpen(byId("beside"), list);
byId("studies-compare").addEventListener("click", () => act(compareStudies));
byId("responses-compare").addEventListener("click", () => act(compareRecords));
byId("comparison-close").addEventListener("click", () => {
  byId("comparison").hidden = true;
  byId("beside").querySelector("summary").focus();
});
