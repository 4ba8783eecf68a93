// The form of an experiment: fields as the server describes them.
import { byId, element } from "./elements.js";
import { answerOf } from "./requests.js";

const OTHER = "other"; // a port that is not listed

let known = null; // as the server described it
let axisShown = ""; // to which the fields that depend on the axis belong
const kept = new Map(); // axis: these fields as filled in for it, never for another one

const form = () => byId("live-form").elements;

export async function fillForm() {
  const answer = await answerOf("/live/form");
  if (!answer?.ok) return;
  const found = await answer.json();
  const isFirst = known === null;
  known = found;
  const chosen = form().axis.value;
  options(form().axis, [
    ["", "choose"],
    [known.simulated, "Simulated axis"],
    ...known.ports.map((one) => [one.path, one.title]),
    [OTHER, "Another port"],
  ]);
  form().axis.value = chosen;
  const file = form().file.value;
  options(form().file, [["", "Designed multisine"], ...known.files.map((name) => [name, name])]);
  form().file.value = known.files.includes(file) ? file : "";
  const model = form().model.value;
  options(form().model, [["", "the axis of the demo"], ...known.models.map((name) => [name, `the model ${name.replace("models/", "")}`])]);
  form().model.value = known.models.includes(model) ? model : "";
  if (isFirst) makeFields();
  showParts();
}

function makeFields() {
  options(form().effect, known.effects.map((name) => [name, name.replaceAll("_", " ") || "none"]));
  options(form().lines, known.lines.map((name) => [name, name]));
  for (const [group, fields] of Object.entries(known.fields)) byId(`live-${group}`).append(...fields.map(fieldOf));
  recall();
  form().axis.addEventListener("change", showParts);
  form().file.addEventListener("change", showParts);
}

function fieldOf(field) {
  const label = element("label", field.unit ? `${field.title} [${field.unit}]` : field.title);
  const input = element("input", "", { name: field.name, inputMode: field.whole ? "numeric" : "decimal", value: field.default });
  label.append(input, element("small", field.why));
  return label;
}

function options(select, pairs) {
  select.replaceChildren(...pairs.map(([value, text]) => element("option", text, { value })));
}

const ofTheAxis = () => Object.values(known.fields).flat().filter((one) => one.simulated);

// What was filled in for the last experiment.
function recall() {
  const { last } = known;
  for (const { name } of Object.values(known.fields).flat()) if (last[name]) form()[name].value = last[name];
  if (last.axis) kept.set(last.axis, Object.fromEntries(ofTheAxis().map(({ name }) => [name, last[name] ?? ""])));
  if (last.path) form().path.value = last.path;
  form().axis.value = last.axis ?? "";
  if (form().axis.value === last.axis) axisShown = last.axis;
  else for (const { name } of ofTheAxis()) form()[name].value = "";
}

// Limits and amplitude hold for one axis: another one begins without, the simulated one with its own.
function showParts() {
  const axis = form().axis.value;
  const isSimulated = axis === known.simulated;
  byId("live-simulated").hidden = !isSimulated;
  byId("live-path").hidden = axis !== OTHER;
  byId("live-excitation").hidden = Boolean(form().file.value);
  if (axis === axisShown) return;
  kept.set(axisShown, Object.fromEntries(ofTheAxis().map(({ name }) => [name, form()[name].value])));
  for (const { name, simulated } of ofTheAxis()) form()[name].value = kept.get(axis)?.[name] ?? (isSimulated ? simulated : "");
  axisShown = axis;
}

export function formValues() {
  const values = {};
  for (const one of form()) if (one.name) values[one.name] = one.type === "checkbox" ? one.checked : one.value;
  values.port = values.axis === OTHER ? values.path : values.axis;
  return values;
}
