// The steps of the study: their buttons, their answers and pictures, and what may follow.
import { cutForm } from "./cut.js";
import { byId, element, isChanged, server } from "./elements.js";
import { goOnFrom, showRivals, showStepBack } from "./models.js";
import { keep, kept } from "./kept.js";
import { runButton, wantedOfNext } from "./next.js";
import { drawPicture } from "./picture.js";
import { chosenRecords } from "./records.js";
import { showRanking } from "./ranking.js";
import { act, post } from "./requests.js";
import { fileLink } from "./save.js";

const ELSEWHERE = ["next", "add", "cut", "report", "export-c"]; // their buttons are beside what they act on

export function readingOf() {
  const fields = [...byId("reading").querySelectorAll("input, select")];
  return Object.fromEntries(fields.filter((one) => one.name && one.value).map((one) => [one.name, one.value]));
}

export function keepChoices() {
  keep("model", { chosen: byId("model").value, newest: server.state?.models.at(-1) ?? "" });
  keep("reading", readingOf());
}

export function requestStep(wanted) {
  const body = { records: chosenRecords(), model: byId("model").value, options: readingOf(), ...wanted };
  return post("/steps", JSON.stringify(body), { headers: { "Content-Type": "application/json" } });
}

// A button that is off keeps the focus, unlike a disabled one.
export function button(verb, extra = {}, text = null) {
  const action = server.state.actions[verb];
  const made = element("button", text ?? action.title, { type: "button", title: action.summary });
  made.dataset.verb = verb;
  made.addEventListener("click", () => isOff(made) || act(() => requestStep({ verb, ...(extra instanceof Function ? extra() : extra) })));
  return made;
}

export const isOff = (one) => one.getAttribute("aria-disabled") === "true";

export function showActions() {
  const offered = Object.keys(server.state.actions).filter((verb) => !ELSEWHERE.includes(verb));
  if (!isChanged("actions", server.state.actions)) return;
  byId("actions").replaceChildren(...offered.map((verb) => button(verb)));
  byId("next-experiment").replaceChildren(button("next", wantedOfNext));
}

export function showWhatIsOff() {
  for (const one of document.querySelectorAll("button[data-verb]")) {
    const needsModel = server.state.actions[one.dataset.verb].needs_model;
    const off = Boolean(server.state.job) || !server.state.records.length || (needsModel && !server.state.models.length);
    one.setAttribute("aria-disabled", String(off));
  }
  for (const one of document.querySelectorAll("button[data-begins]")) one.setAttribute("aria-disabled", String(Boolean(server.state.job)));
}

export function showModels() {
  if (!isChanged("models", server.state.models)) return;
  const select = byId("model");
  const last = server.state.steps.at(-1);
  const isNext = last?.model && last.base === select.value; // made from the chosen one
  const isNewest = select.value === [...select.options].at(-1).value;
  const newest = server.state.models.at(-1) ?? "";
  const asKept = select.options.length === 1 && kept.model?.newest === newest ? kept.model.chosen : null; // a reload
  const chosen = asKept ?? (isNewest || isNext ? newest : select.value);
  const options = ["", ...server.state.models].map((name) =>
    element("option", name ? name.replace("models/", "") : "none", { value: name }),
  );
  select.replaceChildren(...options);
  select.value = chosen;
  showStepBack();
  showRivals();
}

function showStep(step) {
  const item = element("li", "", { id: `step-${step.number}`, className: step.failed ? "failed" : "", tabIndex: -1 });
  const [answer, ...notes] = step.words;
  item.append(element("h3", step.title));
  item.append(element("p", answer, { className: "answer" }));
  if (step.picture) {
    const box = element("div", "", { className: "picture" });
    item.append(box);
    const failed = () => (box.textContent = "The picture could not be drawn. Reload the page.");
    drawPicture(box, `/files/${step.picture}`, `${step.verb}: ${answer}`)
      .then(() => step.verb === "look" && step.records.length === 1 && box.after(cutForm(step, box)))
      .catch(failed);
  }
  if (step.verb === "diagnose" && step.answer) {
    const laws = element("div", "", { className: "laws" });
    item.append(laws);
    showRanking(step, laws);
  }
  if (step.files.length) item.append(element("p", "Files: ", { className: "files" }));
  for (const name of step.files) item.lastElementChild.append(fileLink(name), " ");
  if (notes.length) {
    const more = element("details", "", { open: step.failed }); // where and hint of an error
    more.append(element("summary", notes.length === 1 ? "1 note" : `${notes.length} notes`), ...notes.map((note) => element("p", note)));
    item.append(more);
  }
  const next = element("div", "", { className: "next" });
  item.append(next, element("code", step.command));
  return item;
}

// A verb that the page has no button for is offered by the command line only.
function nextButton(verb, step) {
  if (verb === "run") return runButton(step);
  if (verb === "next") return [button(verb, wantedOfNext)];
  return server.state.actions[verb] ? [button(verb)] : [];
}

function showNext(step) {
  const isLast = step === server.state.steps.at(-1);
  const effects = isLast && !step.answer ? step.effects.slice(0, 3) : []; // else beside their fingerprints
  const others = isLast ? step.next : [];
  if (!isChanged(`next of ${step.number}`, [effects, others, isLast])) return;
  byId(`step-${step.number}`)
    .querySelector(".next")
    .replaceChildren(
      ...effects.map((effect) => button("add", { effect }, `Add ${effect}`)),
      ...others.flatMap((verb) => nextButton(verb, step)),
      ...(isLast ? [] : goOnFrom(step)),
    );
}

export function showSteps() {
  const list = byId("steps");
  for (const step of server.state.steps) {
    if (!byId(`step-${step.number}`)) list.append(showStep(step));
    showNext(step);
  }
  byId("empty").hidden = server.state.records.length > 0;
}
