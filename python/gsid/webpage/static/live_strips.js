// Signals over time as strips on a canvas. plotly.js needs 30 to 150 ms for such a picture, a canvas one or two:
// it is drawn 20 times a second, beside an axis that moves.
const LEFT = 62; // pixels: titles and numbers
const RIGHT = 8;
const GAP = 14; // between strips
const BOTTOM = 34; // numbers of the time
const FONT = "11px system-ui, sans-serif";
const COLOURS = { signal: "#0072b2", limit: "#d55e00", grid: "#ddd", text: "#444" };

// Strips are objects with title, low, high, limit and most, the end of the vertical axis; all over the same time.
export function drawStrips(canvas, time, strips) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  const [begin, end] = [time[0], Math.max(time.at(-1), time[0] + 1e-9)];
  const place = (t) => LEFT + ((t - begin) / (end - begin)) * (width - LEFT - RIGHT);
  const size = (height - BOTTOM) / strips.length;
  strips.forEach((strip, i) => {
    const frame = { left: LEFT, right: width - RIGHT, top: i * size + GAP / 2, bottom: (i + 1) * size - GAP / 2 };
    drawStrip(pen, frame, time.map(place), strip);
  });
  drawTime(pen, begin, end, place, height);
}

function drawStrip(pen, frame, x, { title, low, high, limit, most }) {
  const middle = (frame.top + frame.bottom) / 2;
  const y = (value) => middle - (value / most) * (middle - frame.top);
  for (const value of ticksOf(-most, most, 5)) {
    line(pen, COLOURS.grid, frame.left, frame.right, y(value));
    text(pen, String(value), frame.left - 5, y(value), "right");
  }
  pen.save();
  pen.translate(11, middle);
  pen.rotate(-Math.PI / 2);
  text(pen, title, 0, 0, "center");
  pen.restore();
  if (limit < most) for (const value of [-limit, limit]) line(pen, COLOURS.limit, frame.left, frame.right, y(value), [6, 4]);
  drawRange(pen, x, low.map(y), high.map(y), low);
}

// The range between the extremes; a bin without a sample leaves a gap.
function drawRange(pen, x, bottom, top, low) {
  pen.fillStyle = COLOURS.signal;
  for (let i = 0; i < x.length; i += 1) {
    if (low[i] === null) continue;
    const from = i ? x[i - 1] : x[i];
    pen.fillRect(from, top[i] - 0.6, Math.max(1, x[i] - from), bottom[i] - top[i] + 1.2);
  }
}

function drawTime(pen, begin, end, place, height) {
  for (const t of ticksOf(begin, end, 6)) text(pen, String(t), place(t), height - BOTTOM + 8, "center");
  text(pen, "time [s]", (place(begin) + place(end)) / 2, height - 8, "center");
}

function line(pen, colour, from, to, y, dash = []) {
  pen.strokeStyle = colour;
  pen.setLineDash(dash);
  pen.beginPath();
  pen.moveTo(from, y);
  pen.lineTo(to, y);
  pen.stroke();
}

function text(pen, words, x, y, align) {
  pen.fillStyle = COLOURS.text;
  pen.textAlign = align;
  pen.textBaseline = "middle";
  pen.fillText(words, x, y);
}

// About so many round numbers in a range.
function ticksOf(from, to, number) {
  const raw = (to - from) / number;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((one) => one * power >= raw) * power;
  const ticks = [];
  for (let i = Math.ceil(from / step); i * step <= to; i += 1) ticks.push(Number((i * step).toPrecision(6)));
  return ticks;
}
