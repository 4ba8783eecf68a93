// Elements of the page, the newest state of the server, and what each part of the page shows of it.
export const byId = (id) => document.getElementById(id);

export const server = { state: null }; // as the server last sent it

const drawn = new Map(); // part of the page: the data that it shows, as JSON

export function element(tag, text = "", properties = {}) {
  const made = Object.assign(document.createElement(tag), properties);
  made.textContent = text; // never as markup: names and units come from files
  return made;
}

// Whether a part of the page has to be drawn again: nodes that stay keep the focus.
export function isChanged(part, data) {
  const now = JSON.stringify(data);
  if (drawn.get(part) === now) return false;
  drawn.set(part, now);
  return true;
}

// Fills a folded part of the page each time it is opened, also when that was before the script ran.
export function whenOpen(folded, action) {
  folded.addEventListener("toggle", () => folded.open && action());
  if (folded.open) action();
}
