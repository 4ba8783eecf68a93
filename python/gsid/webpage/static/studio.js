// The page of a study: it shows the server's state and posts requests. The server decides; nothing is kept here.
import { drawPicture } from "./picture.js";

const PATIENCE_MS = 200; // between two looks at the server
const RETRY_MS = 1000; // after a lost connection

const byId = (id) => document.getElementById(id);
let state = null;
const ticked = new Map(); // record: whether the next step uses it
const drawn = new Map(); // part of the page: the data that it shows, as JSON

function element(tag, text = "", properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  made.textContent = text; // never as markup: names and units come from files
  return made;
}

// Whether a part of the page has to be drawn again: nodes that stay keep the focus.
function isChanged(part, data) {
  const now = JSON.stringify(data);
  if (drawn.get(part) === now) return false;
  drawn.set(part, now);
  return true;
}

// ---- requests ----------------------------------------------------------------------------------

let refusals = []; // since the user's last action

async function post(path, body, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { method: "POST", body, ...options });
    if (answer.ok) return await answer.json();
  } catch {
    showError(await whyNoAnswer(body));
    return null;
  }
  const refusal = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
  showError([refusal.error, refusal.where, refusal.hint].filter(Boolean).join(" – "));
  return null;
}

async function whyNoAnswer(body) {
  const isThere = (await answerOf("/state"))?.ok;
  if (isThere && body instanceof File) return `the browser could not send the file – ${body.name}`;
  return "no connection to gsid studio";
}

// The answer to a request, null without a connection.
const answerOf = (path) => fetch(path).catch(() => null);

function showError(text) {
  refusals.push(text);
  showErrors();
}

function showErrors() {
  const texts = [state?.error, ...refusals].filter(Boolean);
  if (!isChanged("errors", texts)) return;
  byId("error").textContent = texts.join("\n");
  byId("error").hidden = !texts.length;
}

// An action of the user: what was refused before is no longer of interest.
function act(action) {
  refusals = [];
  showErrors();
  return action();
}

// ---- records -----------------------------------------------------------------------------------

async function open(files) {
  for (const file of files) {
    const found = await post(`/records?name=${encodeURIComponent(file.name)}`, file);
    if (!found) continue;
    ticked.set(found.record, true);
    if (!(await idle())) return;
    await requestStep({ verb: "look", records: [found.record] });
  }
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

function showRecords() {
  if (!isChanged("records", state.records)) return;
  const list = byId("records");
  for (const item of [...list.children]) if (!state.records.includes(item.dataset.record)) item.remove();
  state.records.forEach((name, place) => {
    const there = list.children[place];
    if (there?.dataset.record !== name) list.insertBefore(recordItem(name), there ?? null);
  });
}

function recordItem(name) {
  const item = element("li");
  item.dataset.record = name;
  const box = element("input", "", { type: "checkbox", checked: ticked.get(name) ?? true });
  box.addEventListener("change", () => ticked.set(name, box.checked));
  const label = element("label");
  label.append(box, ` ${name.replace("records/", "")}`);
  item.append(label);
  return item;
}

const chosenRecords = () => (state?.records ?? []).filter((name) => ticked.get(name) ?? true);

// ---- steps -------------------------------------------------------------------------------------

function reading() {
  const fields = [...byId("reading").querySelectorAll("input, select")];
  return Object.fromEntries(fields.filter((one) => one.value).map((one) => [one.name, one.value]));
}

function requestStep(wanted) {
  const body = { records: chosenRecords(), model: byId("model").value, options: reading(), ...wanted };
  return post("/steps", JSON.stringify(body), { headers: { "Content-Type": "application/json" } });
}

// A button that is off keeps the focus, unlike a disabled one.
function button(verb, extra = {}, text = null) {
  const action = state.actions[verb];
  const made = element("button", text ?? action.title, { type: "button", title: action.summary });
  made.dataset.verb = verb;
  made.addEventListener("click", () => isOff(made) || act(() => requestStep({ verb, ...extra })));
  return made;
}

const isOff = (one) => one.getAttribute("aria-disabled") === "true";

function showActions() {
  const offered = Object.keys(state.actions).filter((verb) => verb !== "add");
  if (isChanged("actions", state.actions)) byId("actions").replaceChildren(...offered.map((verb) => button(verb)));
}

function showWhatIsOff() {
  for (const one of document.querySelectorAll("button[data-verb]")) {
    const needsModel = state.actions[one.dataset.verb].needs_model;
    const off = Boolean(state.job) || !state.records.length || (needsModel && !state.models.length);
    one.setAttribute("aria-disabled", String(off));
  }
}

function showModels() {
  if (!isChanged("models", state.models)) return;
  const select = byId("model");
  const wasNewest = select.value === [...select.options].at(-1).value;
  const chosen = wasNewest ? (state.models.at(-1) ?? "") : select.value;
  const options = ["", ...state.models].map((name) =>
    element("option", name ? name.replace("models/", "") : "none", { value: name }),
  );
  select.replaceChildren(...options);
  select.value = chosen;
}

function showStep(step) {
  const item = element("li", "", { id: `step-${step.number}`, className: step.failed ? "failed" : "", tabIndex: -1 });
  const [answer, ...notes] = step.words;
  item.append(element("h3", state.actions[step.verb]?.title ?? step.verb));
  item.append(element("p", answer, { className: "answer" }));
  if (step.picture) {
    const box = element("div", "", { className: "picture" });
    item.append(box);
    const failed = () => (box.textContent = "The picture could not be drawn. Reload the page.");
    drawPicture(box, `/files/${step.picture}`, `${step.verb}: ${answer}`).catch(failed);
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
  const isLast = step === state.steps.at(-1);
  const effects = isLast ? step.effects.slice(0, 3) : [];
  const others = isLast ? step.next : [];
  if (!isChanged(`next of ${step.number}`, [effects, others])) return;
  byId(`step-${step.number}`)
    .querySelector(".next")
    .replaceChildren(
      ...effects.map((effect) => button("add", { effect }, `Add ${effect}`)),
      ...others.map((verb) => button(verb)),
    );
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
  if (!state.job || !isChanged("job", state.job)) return;
  byId("job-step").textContent = state.job.stopping ? "stopping" : state.job.step;
  byId("job-command").textContent = state.job.command;
  byId("stop").setAttribute("aria-disabled", String(Boolean(state.job.stopping)));
}

function show() {
  const focused = document.activeElement;
  showRecords();
  showModels();
  showActions();
  showSteps();
  showWhatIsOff();
  showJob();
  showErrors();
  const isLost = !focused.isConnected || focused.closest("[hidden]");
  if (isLost) byId("steps").lastElementChild?.focus(); // what was pressed is gone: on with the new step
}

// ---- connection --------------------------------------------------------------------------------

function connect() {
  const socket = new WebSocket(`ws://${location.host}/changes`);
  socket.addEventListener("open", () => (byId("connection").textContent = "connected"));
  socket.addEventListener("message", (event) => {
    state = JSON.parse(event.data);
    show();
  });
  socket.addEventListener("close", reconnect);
}

async function reconnect() {
  byId("connection").textContent = "no connection: trying again";
  const isRefused = (await answerOf("/state"))?.status === 403;
  if (isRefused) byId("connection").textContent = "no connection: open the address that gsid studio printed";
  else setTimeout(connect, RETRY_MS);
}

byId("chooser").addEventListener("change", (event) => {
  const files = [...event.target.files];
  event.target.value = ""; // the same file may be chosen again
  act(() => open(files));
});
byId("drop").addEventListener("dragover", (event) => event.preventDefault());
byId("drop").addEventListener("drop", (event) => {
  event.preventDefault();
  act(() => open([...event.dataTransfer.files]));
});
byId("stop").addEventListener("click", (event) => isOff(event.target) || act(() => post("/stop", "")));
connect();
