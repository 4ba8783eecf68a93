// Which model is chosen: one step back, or the one of an earlier step. Nothing is deleted.
import { byId, element, isChanged, server } from "./elements.js";

function choose(model) {
  byId("model").value = model;
  byId("model").dispatchEvent(new Event("change", { bubbles: true }));
  byId("model").focus();
}

// The model that the step started from which wrote the chosen one.
function before() {
  const chosen = byId("model").value;
  return server.state.steps.findLast((step) => step.model === chosen)?.base ?? null;
}

export function showStepBack() {
  const base = server.state && before();
  byId("step-back").setAttribute("aria-disabled", String(!base));
  byId("step-back").title = base ? `Chooses ${base.replace("models/", "")}; nothing is deleted` : "The chosen model has none before it";
}

// A button of an earlier step: what follows starts from its model again.
export function goOnFrom(step) {
  const model = step.model ?? step.base;
  if (!model) return [];
  const made = element("button", "Go on from here", { type: "button", title: `Chooses ${model.replace("models/", "")}` });
  made.addEventListener("click", () => choose(model));
  return [made];
}

// The models from which an experiment may distinguish the chosen one.
export function showRivals() {
  const others = (server.state?.models ?? []).filter((name) => name !== byId("model").value);
  if (!isChanged("rivals", others)) return;
  const options = others.map((name) => element("option", name.replace("models/", ""), { value: name }));
  byId("rival").replaceChildren(...options);
  byId("rival").value = before() ?? others.at(-1) ?? "";
}

byId("step-back").addEventListener("click", () => before() && choose(before()));
byId("model").addEventListener("change", () => {
  showStepBack();
  showRivals();
});
