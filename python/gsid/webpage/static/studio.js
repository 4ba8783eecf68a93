// The page of a study: it shows the server's state and posts requests. The server decides; nothing is kept here.
import "./beside.js";
import { byId, isChanged, server } from "./elements.js";
import { open, showRecords } from "./records.js";
import { act, answerOf, post, showErrors } from "./requests.js";
import { showSave } from "./save.js";
import { isOff, showActions, showModels, showSteps, showWhatIsOff } from "./steps.js";
import { showWorkbench } from "./workbench.js";

const RETRY_MS = 1000; // after a lost connection

function showJob() {
  byId("job").hidden = !server.state.job;
  if (!server.state.job || !isChanged("job", server.state.job)) return;
  byId("job-step").textContent = server.state.job.stopping ? "stopping" : server.state.job.step;
  byId("job-command").textContent = server.state.job.command;
  byId("stop").setAttribute("aria-disabled", String(Boolean(server.state.job.stopping)));
}

function show() {
  const focused = document.activeElement;
  showRecords();
  showModels();
  showSave();
  showActions();
  showSteps();
  showWorkbench();
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
    server.state = JSON.parse(event.data);
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
byId("model").addEventListener("change", showSave);
byId("stop").addEventListener("click", (event) => isOff(event.target) || act(() => post("/stop", "")));
connect();
