// An experiment while it runs: the connection with its control, the bar with Stop, and what is drawn.
import { byId, whenOpen } from "./elements.js";
import { fillForm, formValues } from "./live_form.js";
import { clearPicture, drawFigures, newestOf } from "./live_picture.js";
import { act, answerOf, post } from "./requests.js";
import { isOff } from "./steps.js";

const RETRY_MS = 300; // a reload or a short loss does not end the experiment
const KEY = "gsid control"; // of this tab; a reload keeps it

let socket = null;
let now = { token: "", running: false }; // as the server last sent it
let isNew = true; // the next message begins with the history of the run
let isDrawing = false;
let wantsFocus = false; // this page has just started the experiment
let waiting = []; // sets of figures that are not drawn yet

// ---- connection ---------------------------------------------------------------------------------

function connect() {
  socket = new WebSocket(`ws://${location.host}/live`);
  socket.addEventListener("open", () => {
    isNew = true;
    socket.send(sessionStorage.getItem(KEY) ?? "");
  });
  socket.addEventListener("message", (event) => {
    socket.send("read"); // a sign of life; it does not wait for the drawing
    take(JSON.parse(event.data));
  });
  socket.addEventListener("close", reconnect);
}

async function reconnect() {
  showLost();
  const isRefused = (await answerOf("/state"))?.status === 403; // another server: its address is needed
  if (!isRefused) setTimeout(connect, RETRY_MS);
}

function take(message) {
  if (isNew || message.run !== now.run) {
    waiting = [];
    clearPicture();
    if (message.run !== now.run) byId("live").hidden = true;
  }
  isNew = false;
  if (message.token !== now.token) sessionStorage.setItem(KEY, message.token);
  now = message;
  waiting = newestOf([...waiting, ...message.figures]);
  now.figures = [];
  showBar();
  if (waiting.length && !isDrawing) {
    isDrawing = true;
    requestAnimationFrame(draw);
  }
}

async function draw() {
  const newest = waiting;
  waiting = [];
  if (!newest.length) {
    isDrawing = false; // another run has begun meanwhile
    return;
  }
  if (byId("live").hidden) {
    byId("live").hidden = false;
    if (now.running) byId("live").scrollIntoView();
  }
  try {
    await drawFigures(newest);
    showStatus(newest.at(-1));
  } finally {
    isDrawing = false;
  }
  if (waiting.length) {
    isDrawing = true;
    requestAnimationFrame(draw);
  }
}

// ---- the bar ------------------------------------------------------------------------------------

const CONTROL = {
  own: () => "This page holds control.",
  other: () => "Another page holds control.",
  none: () => `No page holds control: the run stops ${now.absent_s} s after the last one has gone.`,
};

function showBar() {
  byId("live-bar").hidden = !now.running;
  if (now.running && wantsFocus) {
    wantsFocus = false;
    byId("live-stop").focus({ preventScroll: true }); // what was pressed is folded away
  }
  document.body.classList.toggle("live-runs", now.running); // the bar takes the place of the usual job
  byId("live-command").textContent = now.command;
  const control = CONTROL[now.control]() + (now.n_pages > 1 ? ` ${now.n_pages} pages watch.` : "");
  if (byId("live-control").textContent !== control) byId("live-control").textContent = control; // it is read aloud
  byId("live-take").hidden = now.control === "own";
  byId("live-stop").textContent = now.stopping ? "Stopping" : "Stop the axis";
  if (now.running && byId("live-status").textContent === "") byId("live-status").textContent = "Waiting for the axis.";
  if (!now.running) byId("live-status").textContent = "";
}

function showLost() {
  if (now.running) byId("live-control").textContent = `No connection to gsid studio: the run stops after ${now.absent_s} s.`;
}

function showStatus(figures) {
  if (!now.running) return;
  const isDone = figures.good >= figures.requested;
  const period = isDone ? "All periods are measured" : `Period ${figures.good + 1} of ${figures.requested}`;
  const left = isDone || figures.left_s === null ? "" : `, ${figures.left_s.toFixed(0)} s left`;
  const spoiled = figures.spoiled ? `, ${figures.spoiled} spoiled by lost samples: check cable, grounding and baud rate` : "";
  byId("live-status").textContent = `${period}${left}${spoiled}.`;
}

function stop() {
  byId("live-stop").textContent = "Stopping";
  return act(() => post("/stop", ""));
}

byId("live-stop").addEventListener("click", stop);
byId("live-take").addEventListener("click", () => socket.send("take"));
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape" && now.running) stop();
});

// ---- the form -----------------------------------------------------------------------------------

async function start() {
  const body = JSON.stringify({ token: now.token, ...formValues() });
  const begun = await post("/live/run", body, { headers: { "Content-Type": "application/json" } });
  if (!begun) byId("error").scrollIntoView({ block: "center" });
  else {
    byId("experiment").open = false;
    wantsFocus = true;
  }
}

whenOpen(byId("experiment"), fillForm);
byId("live-form").addEventListener("submit", (event) => {
  event.preventDefault();
  if (!isOff(event.target.querySelector("[type=submit]"))) act(start);
});
connect();
