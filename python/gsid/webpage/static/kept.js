// What a reload shows again: it is kept in the study.
const PAUSE_MS = 300; // after the last change

const load = async () => (await fetch("/kept")).json();
export const kept = await load().catch(() => ({}));

let pause = 0;

export function keep(part, value) {
  kept[part] = value;
  clearTimeout(pause);
  pause = setTimeout(() => fetch("/kept", { method: "POST", body: JSON.stringify(kept) }).catch(() => null), PAUSE_MS);
}
