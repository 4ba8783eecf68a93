// A picture that a command drew, as a plotly figure with a text for readers who cannot see it.
export async function drawPicture(box, address, description) {
  const answer = await fetch(address);
  if (!answer.ok) {
    box.textContent = "The picture is not there.";
    return;
  }
  const figure = await answer.json();
  const narrow = box.clientWidth < 600;
  box.style.height = `${figure.layout.height * (narrow ? 0.8 : 1)}px`;
  box.setAttribute("role", "img");
  box.setAttribute("aria-label", description);
  const layout = { ...figure.layout, autosize: true, height: undefined };
  if (narrow) layout.font = { size: 9 };
  await Plotly.newPlot(box, figure.data, layout, { responsive: true, displaylogo: false });
}
