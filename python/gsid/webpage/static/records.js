// The records of the study: opened, listed, ticked.
import { byId, element, isChanged, server } from "./elements.js";
import { keep, kept } from "./kept.js";
import { answerOf, post, showError } from "./requests.js";
import { keepChoices, requestStep } from "./steps.js";

const PATIENCE_MS = 200; // between two looks at the server
const ticked = new Map(Object.entries(kept.ticked ?? {})); // record: whether the next step uses it

export async function open(files) {
  let more = ""; // what is opened together is one experiment
  for (const file of files) {
    const found = await post(`/records?name=${encodeURIComponent(file.name)}${more}`, file);
    if (!found) continue;
    more = "&with=last";
    ticked.set(found.record, true);
    if (!hasSignals(found)) continue;
    if (!(await idle())) return;
    await requestStep({ verb: "look", records: [found.record] });
  }
}

// Whether input and output are named u and y, or were chosen; else the user is asked to choose them.
function hasSignals({ record, columns }) {
  const missing = ["--u", "--y"].map(readingField).filter((field) => !columns.includes(field.value || field.placeholder));
  if (columns.length < 2 || !missing.length) return true; // nothing to choose from: the next step has the error
  byId("reading").closest("details").open = true;
  showColumns(columns);
  missing[0].focus();
  showError(`Choose the input and the output of ${ownName(record)}: its columns are ${columns.join(", ")}. Then look at the record.`);
  return false;
}

const readingField = (name) => byId("reading").querySelector(`[name="${name}"]`);
const ownName = (record) => record.replace("records/", "");

function showColumns(columns) {
  byId("columns").replaceChildren(...columns.map((name) => element("option", "", { value: name })));
}

// Waits until no step runs; false without a connection. It asks the server: messages may arrive late.
async function idle() {
  for (;;) {
    const answer = await answerOf("/state");
    if (!answer?.ok) return false;
    if (!(await answer.json()).job) return true;
    await new Promise((resolve) => setTimeout(resolve, PATIENCE_MS));
  }
}

export function showRecords() {
  if (!isChanged("records", server.state.records)) return;
  showColumns([...new Set(Object.values(server.state.columns).flat())]);
  const list = byId("records");
  for (const item of [...list.children]) if (!server.state.records.includes(item.dataset.record)) item.remove();
  server.state.records.forEach((name, place) => {
    const there = list.children[place];
    if (there?.dataset.record !== name) list.insertBefore(recordItem(name), there ?? null);
  });
}

function recordItem(name) {
  const item = element("li");
  item.dataset.record = name;
  const box = element("input", "", { type: "checkbox", checked: ticked.get(name) ?? true });
  box.addEventListener("change", () => {
    ticked.set(name, box.checked);
    keep("ticked", Object.fromEntries(ticked));
  });
  const label = element("label");
  label.append(box, ` ${ownName(name)}`);
  item.append(label);
  return item;
}

export const chosenRecords = () => (server.state?.records ?? []).filter((name) => ticked.get(name) ?? true);

for (const [name, value] of Object.entries(kept.reading ?? {})) if (readingField(name)) readingField(name).value = value;
for (const part of ["reading", "model"]) byId(part).addEventListener("change", keepChoices);

// The unit that a column has in the file fills the factor and the unit after it.
for (const choice of byId("reading").querySelectorAll("[data-converts]")) {
  choice.addEventListener("change", () => {
    const [unit, factor = ""] = choice.value.split("|");
    const own = (part) => readingField(`--${choice.dataset.converts}-${part}`);
    own("unit").value = unit;
    own("factor").value = factor;
    if (choice.value === "counts|") own("factor").focus();
  });
}
