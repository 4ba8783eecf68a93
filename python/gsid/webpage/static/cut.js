// The part of a record to keep: two times, which follow what the picture is zoomed to.
import { element } from "./elements.js";
import { act } from "./requests.js";
import { isOff, requestStep } from "./steps.js";

const DECIMALS = 6; // of a time: a millionth of a second is less than a sample

// Below the picture of a single record that was looked at.
export function cutForm(step, picture) {
  const form = element("form", "", { className: "cut" });
  const [from, to] = ["from", "to"].map((name) => timeField(form, name));
  const keep = element("button", "Keep this part", { type: "submit", title: "Zoom the picture to a part, or type its times" });
  keep.dataset.verb = "cut";
  form.append(keep);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const part = { from: from.value, to: to.value };
    if (!isOff(keep)) act(() => requestStep({ verb: "cut", records: step.records, ...part }));
  });
  followZoom(picture, from, to);
  return form;
}

function timeField(form, name) {
  const label = element("label", `${name} [s] `);
  const field = element("input", "", { name, inputMode: "decimal", required: true });
  label.append(field);
  form.append(label);
  return field;
}

// The first axis of the picture is time, over the whole record until it is zoomed.
function followZoom(picture, from, to) {
  const whole = [...picture.layout.xaxis.range];
  const show = () => {
    const [begin, end] = picture.layout.xaxis.range;
    from.value = Number(Math.max(begin, whole[0]).toFixed(DECIMALS));
    to.value = Number(Math.min(end, whole[1]).toFixed(DECIMALS));
  };
  show();
  picture.on("plotly_relayout", show);
}
