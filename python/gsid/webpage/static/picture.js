// A picture that a command drew, as a plotly figure with a text for readers who cannot see it.
const NARROW = 600; // pixels: columns of axes are stacked below

export async function drawPicture(box, address, description) {
  const answer = await fetch(address);
  if (!answer.ok) {
    box.textContent = "The picture is not there.";
    return;
  }
  const figure = await answer.json();
  const narrow = box.clientWidth < NARROW;
  const columns = narrow ? stack(figure.layout) : 1;
  box.style.height = `${figure.layout.height * columns * (narrow ? 0.8 : 1)}px`;
  box.setAttribute("role", "img");
  box.setAttribute("aria-label", description);
  const layout = { ...figure.layout, autosize: true, height: undefined };
  if (narrow) layout.font = { size: 9 };
  await Plotly.newPlot(box, figure.data, layout, { responsive: true, displaylogo: false });
}

// Puts the columns of a picture one below the other, each over the whole width; returns their number.
function stack(layout) {
  const names = Object.keys(layout).filter((name) => /^xaxis\d*$/.test(name));
  const panels = names.map((name) => ({ x: layout[name], y: layout[name.replace("x", "y")] }));
  panels.sort((one, other) => one.x.domain[0] - other.x.domain[0]);
  let end = -1;
  let columns = 0;
  for (const panel of panels) {
    if (panel.x.domain[0] >= end) columns += 1;
    panel.column = columns;
    end = Math.max(end, panel.x.domain[1]);
  }
  const left = panels[0]?.x.domain[0];
  for (const { x, y, column } of columns > 1 ? panels : []) {
    x.domain = [left, end];
    y.domain = y.domain.map((place) => (columns - column + place) / columns);
  }
  return Math.max(columns, 1);
}
