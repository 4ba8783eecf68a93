// What can be saved: files of the study as links, to keep or to use elsewhere.
import { byId, element, isChanged } from "./elements.js";
import { button } from "./steps.js";

export function fileLink(name) {
  const place = name.split("/").map(encodeURIComponent).join("/");
  return element("a", name.split("/").at(-1), { href: `/files/${place}`, download: "" });
}

// The chosen model, the commands, and what is made of them.
export function showSave() {
  const model = byId("model").value;
  if (!isChanged("save", [model])) return;
  const files = [...(model ? [model] : []), "commands.log"].map(fileLink);
  const script = element("a", "study.py", { href: "/study.py", download: "study.py" });
  byId("save").replaceChildren(...files, script, button("report"), button("export-c"));
}
