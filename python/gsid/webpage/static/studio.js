// The page of a study: it shows the server's state and posts wishes. The server decides; nothing is kept here.
import { drawPicture } from "./picture.js";

const byId = (id) => document.getElementById(id);
let state = null;
const ticked = new Map(); // record: whether the next step uses it

function element(tag, text = "", properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  made.textContent = text; // never as markup: names and units come from files
  return made;
}

async function post(path, body, options = {}) {
  hideError();
  const answer = await fetch(path, { method: "POST", body, ...options });
  if (answer.ok) return answer.json();
  const refusal = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
  showError([refusal.error, refusal.where, refusal.hint].filter(Boolean).join(" – "));
  return null;
}

function showError(text) {
  byId("error").textContent = text;
  byId("error").hidden = false;
}

function hideError() {
  byId("error").hidden = true;
}

// ---- records -----------------------------------------------------------------------------------

async function open(files) {
  for (const file of files) {
    const found = await post(`/records?name=${encodeURIComponent(file.name)}`, file);
    if (!found) return;
    ticked.set(found.record, true);
    await wish({ verb: "look", records: [found.record] });
    await idle();
  }
}

// Resolves when no step runs.
function idle() {
  return new Promise((resolve) => {
    const look = () => (state && !state.job ? resolve() : setTimeout(look, 50));
    look();
  });
}

function showRecords() {
  const list = byId("records");
  list.replaceChildren(
    ...state.records.map((name) => {
      const item = element("li");
      const box = element("input", "", { type: "checkbox", checked: ticked.get(name) ?? true });
      box.addEventListener("change", () => ticked.set(name, box.checked));
      const label = element("label");
      label.append(box, ` ${name.replace("records/", "")}`);
      item.append(label);
      return item;
    }),
  );
}

const chosenRecords = () => state.records.filter((name) => ticked.get(name) ?? true);

// ---- steps -------------------------------------------------------------------------------------

function reading() {
  const fields = [...byId("reading").querySelectorAll("input, select")];
  return Object.fromEntries(fields.filter((one) => one.value).map((one) => [one.name, one.value]));
}

async function wish(wanted) {
  const body = { records: chosenRecords(), model: byId("model").value, options: reading(), ...wanted };
  const begun = await post("/steps", JSON.stringify(body), { headers: { "Content-Type": "application/json" } });
  if (begun) state.job ??= { step: "starting", command: "" };
}

function button(verb, extra = {}, text = null) {
  const action = state.actions[verb];
  const made = element("button", text ?? action.title, { type: "button", title: action.summary });
  made.disabled = Boolean(state.job) || !state.records.length || (action.needs_model && !state.models.length);
  made.addEventListener("click", () => wish({ verb, ...extra }));
  return made;
}

function showActions() {
  const offered = Object.keys(state.actions).filter((verb) => verb !== "add");
  byId("actions").replaceChildren(...offered.map((verb) => button(verb)));
}

function showModels() {
  const select = byId("model");
  const before = select.dataset.models;
  const now = state.models.join();
  if (before === now) return;
  select.dataset.models = now;
  const options = ["", ...state.models].map((name) =>
    element("option", name ? name.replace("models/", "") : "none", { value: name }),
  );
  select.replaceChildren(...options);
  select.value = state.models.at(-1) ?? ""; // the newest
}

function showStep(step) {
  const item = element("li", "", { id: `step-${step.number}`, className: step.failed ? "failed" : "" });
  const [answer, ...notes] = step.words;
  item.append(element("h3", state.actions[step.verb]?.title ?? step.verb));
  item.append(element("p", answer, { className: "answer" }));
  if (step.picture) {
    const box = element("div", "", { className: "picture" });
    item.append(box);
    drawPicture(box, `/files/${step.picture}`, `${step.verb}: ${answer}`);
  }
  if (notes.length) {
    const more = element("details");
    more.append(element("summary", notes.length === 1 ? "1 note" : `${notes.length} notes`), ...notes.map((note) => element("p", note)));
    item.append(more);
  }
  const next = element("div", "", { className: "next" });
  item.append(next, element("code", step.command));
  return item;
}

function showNext(step) {
  const box = byId(`step-${step.number}`).querySelector(".next");
  const isLast = step === state.steps.at(-1);
  const effects = step.effects.slice(0, 3).map((effect) => button("add", { effect }, `Add ${effect}`));
  const others = step.next.map((verb) => button(verb));
  box.replaceChildren(...(isLast ? [...effects, ...others] : []));
}

function showSteps() {
  const list = byId("steps");
  for (const step of state.steps) {
    if (!byId(`step-${step.number}`)) list.append(showStep(step));
    showNext(step);
  }
  byId("empty").hidden = state.records.length > 0;
}

function showJob() {
  byId("job").hidden = !state.job;
  if (!state.job) return;
  byId("job-step").textContent = state.job.step;
  byId("job-command").textContent = state.job.command;
}

function show() {
  showRecords();
  showModels();
  showActions();
  showSteps();
  showJob();
}

// ---- connection --------------------------------------------------------------------------------

function connect() {
  const socket = new WebSocket(`ws://${location.host}/changes`);
  socket.addEventListener("open", () => (byId("connection").textContent = "connected"));
  socket.addEventListener("message", (event) => {
    state = JSON.parse(event.data);
    show();
  });
  socket.addEventListener("close", () => {
    byId("connection").textContent = "no connection: trying again";
    setTimeout(connect, 1000);
  });
}

byId("chooser").addEventListener("change", (event) => open([...event.target.files]));
byId("drop").addEventListener("dragover", (event) => event.preventDefault());
byId("drop").addEventListener("drop", (event) => {
  event.preventDefault();
  open([...event.dataTransfer.files]);
});
byId("stop").addEventListener("click", () => post("/stop", ""));
connect();
