// The form of an experiment: fields as the server describes them.
import { byId, element } from "./elements.js";
import { answerOf } from "./requests.js";

const OTHER = "other"; // a port that is not listed

let known = null; // as the server described it
let filledFor = null; // whether defaults of the simulated axis are filled in

const form = () => byId("live-form").elements;

export async function fillForm() {
  const answer = await answerOf("/live/form");
  if (!answer?.ok) return;
  const isFirst = known === null;
  known = await answer.json();
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
  if (isFirst) makeFields();
  showParts();
}

function makeFields() {
  options(form().effect, known.effects.map((name) => [name, name.replaceAll("_", " ") || "none"]));
  options(form().lines, known.lines.map((name) => [name, name]));
  for (const [group, fields] of Object.entries(known.fields)) byId(`live-${group}`).append(...fields.map(fieldOf));
  for (const [name, value] of Object.entries(known.last)) if (form()[name]?.value === "") form()[name].value = value;
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

// Limits of the simulated axis are filled in; they are taken back when a real axis is chosen.
function showParts() {
  const isSimulated = form().axis.value === known.simulated;
  byId("live-simulated").hidden = !isSimulated;
  byId("live-path").hidden = form().axis.value !== OTHER;
  byId("live-excitation").hidden = Boolean(form().file.value);
  for (const field of Object.values(known.fields).flat().filter((one) => one.simulated)) {
    const input = form()[field.name];
    if (isSimulated && !input.value) input.value = field.simulated;
    else if (!isSimulated && filledFor === known.simulated) input.value = "";
  }
  filledFor = form().axis.value;
}

export function formValues() {
  const values = {};
  for (const one of form()) if (one.name) values[one.name] = one.type === "checkbox" ? one.checked : one.value;
  values.port = values.axis === OTHER ? values.path : values.axis;
  return values;
}
