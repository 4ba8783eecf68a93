// Draws each picture with plotly.js when it first comes into view; until then, and in print, the page shows SVG.
const isNarrow = matchMedia("(max-width: 640px)");
const settings = { responsive: true, displaylogo: false };

function draw(place) {
  const figure = JSON.parse(place.nextElementSibling.textContent);
  const traces = (isNarrow.matches && figure.dataNarrow) || figure.data;
  const layout = isNarrow.matches ? figure.narrow : figure.wide;
  place.style.height = `${layout.height}px`; // drawn twice at once, plotly would leave it without a height
  Plotly.react(place, traces, layout, settings);
}

const watch = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) {
    if (!isIntersecting || target.classList.contains("drawn")) continue;
    target.classList.add("drawn");
    draw(target);
  }
});
for (const place of document.querySelectorAll(".plot")) {
  place.parentElement.classList.add("live");
  watch.observe(place);
}
isNarrow.addEventListener("change", () => document.querySelectorAll(".drawn").forEach(draw));
