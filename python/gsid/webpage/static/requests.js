// Requests to the server, and what it refused.
import { byId, isChanged, server } from "./elements.js";

let refusals = []; // since the user's last action

export async function post(path, body, options = {}) {
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
export const answerOf = (path) => fetch(path).catch(() => null);

export function showError(text) {
  refusals.push(text);
  showErrors();
}

export function showErrors() {
  const texts = [server.state?.error, ...refusals].filter(Boolean);
  if (!isChanged("errors", texts)) return;
  byId("error").textContent = texts.join("\n");
  byId("error").hidden = !texts.length;
}

// An action of the user: what was refused before is no longer of interest.
export function act(action) {
  refusals = [];
  showErrors();
  return action();
}
