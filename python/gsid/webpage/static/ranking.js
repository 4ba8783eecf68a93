// The laws that a diagnosis ranks first, each beside the torque that the data miss, with a button that adds it.
import { element, server } from "./elements.js";
import { button, showWhatIsOff } from "./steps.js";

const COLOURS = { measured: "#333333", law: "#0072b2" };

// The linear model to which a law is added: the one that was diagnosed, else the newest that was found before.
function baseOf(step) {
  if (step.base) return step.base;
  return server.state.steps.findLast((one) => one.verb === "start" && one.number < step.number && one.model)?.model;
}

export async function showRanking(step, box) {
  const answer = step.answer && (await fetch(`/files/${step.answer}`).catch(() => null));
  const found = answer?.ok ? await answer.json().catch(() => null) : null;
  const base = baseOf(step);
  const cards = (found?.fingerprints ?? []).map((one) => cardOf(one, base));
  const shown = (found?.fingerprints ?? []).flatMap((one) => one.effects);
  const others = step.effects.filter((effect) => !shown.includes(effect)); // that cannot be simulated
  box.replaceChildren(...cards.map(({ card }) => card), ...others.map((effect) => button("add", { effect }, `Add ${effect}`)));
  for (const { draw } of cards) draw(); // after all have their width
  showWhatIsOff();
}

function cardOf(one, base) {
  const name = one.effects.join(" or ");
  const card = element("section", "", { className: "law" });
  const picture = element("div", "", { className: "fingerprint" });
  picture.setAttribute("role", "img");
  picture.setAttribute("aria-label", `Missing torque over the ${one.variable}, measured and by ${name}`);
  card.append(element("h4", name), picture, element("p", one.sentence));
  if (base) card.append(...one.effects.map((effect) => button("add", { effect, model: base }, `Add ${effect}`)));
  else card.append(element("p", "To add it, find the linear model first.", { className: "unit" }));
  return { card, draw: () => drawFingerprint(picture, one, name) };
}

function drawFingerprint(box, one, name) {
  const bars = { array: one.std.map((std) => 2 * std), color: COLOURS.measured, thickness: 1, width: 0 };
  const data = [
    { x: one.at, y: one.measured, mode: "markers", name: "data, ±2 σ", error_y: bars, marker: { color: COLOURS.measured, size: 4 } },
    { x: one.at, y: one.by_law, mode: "lines", name, line: { color: COLOURS.law, width: 2 } },
  ];
  const unit = one.variable_unit ? ` [${one.variable_unit}]` : "";
  const layout = {
    autosize: true, font: { size: 10 }, margin: { l: 48, r: 6, t: 6, b: 34 }, showlegend: true,
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" },
    xaxis: { title: { text: `${one.variable}${unit}` } },
    yaxis: { title: { text: `missing torque / inertia [${one.unit}]` } },
  };
  Plotly.newPlot(box, data, layout, { responsive: true, displayModeBar: false });
}
