// The next experiment: what it is for and within which limits, and the form of the run that measures it.
import { byId, element } from "./elements.js";
import { fillForm } from "./live_form.js";
import { act, answerOf } from "./requests.js";

const fields = () => [...byId("next-form").querySelectorAll("input, select")];

// What the step of the proposal is requested with.
export function wantedOfNext() {
  return Object.fromEntries(fields().map((one) => [one.name, one.value]));
}

function showGoal() {
  const goal = byId("next-form").querySelector("[name=goal]").value;
  for (const one of byId("next-form").querySelectorAll("[data-goals]")) one.hidden = !one.dataset.goals.split(" ").includes(goal);
  byId("next-form").querySelector("[name=limit_command]").placeholder = goal === "rival" ? "no limit" : "as measured";
}

// Below a proposal: fills in the form of an experiment with it. The axis does not move before "Start".
export function runButton(step) {
  const file = step.files.find((name) => name.startsWith("excitation/"));
  if (!file) return [];
  const made = element("button", "Fill in the experiment", { type: "button", title: "Excitation and length of the form below; the axis does not move yet" });
  made.addEventListener("click", () => act(() => fillIn(file, step.answer)));
  return [made];
}

async function fillIn(file, answerName) {
  const answer = await answerOf(`/files/${answerName}`);
  const found = answer?.ok ? await answer.json() : {};
  byId("experiment").open = true;
  await fillForm();
  const form = byId("live-form").elements;
  const values = { file, periods: found.n_periods, settle: found.wait_periods };
  for (const [name, value] of Object.entries(values)) if (value !== undefined) form[name].value = value;
  form.file.dispatchEvent(new Event("change"));
  byId("experiment").scrollIntoView();
  form.axis.focus({ preventScroll: true });
}

byId("next-form").addEventListener("change", showGoal);
showGoal(); // a reload may keep the choice
