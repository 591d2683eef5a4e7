// Diagrams in SVG, drawn to the width they have, with one marker that says where the run is.

const SVG = "http://www.w3.org/2000/svg";
const MARGIN = {left: 62, right: 16, top: 10, bottom: 42}, NEAR_ENOUGH = 28; // pixels
const LETTER = 6.6, LINE = 14; // pixels that a letter is wide at most as a rule, and a line of text is high

function element(name, attributes, parent) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (parent) parent.appendChild(node);
  return node;
}

// Round numbers that divide [low, high] into some `wanted` parts.
function ticks(low, high, wanted) {
  const rough = (high - low) / wanted, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999), marks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) marks.push(i * step);
  return marks.map((x) => (Math.abs(x) < 1e-9 * step ? 0 : x));
}

// The lines of a text that is to fit into so many pixels.
function wrapped(text, pixels) {
  const lines = [""];
  for (const word of text.split(" ")) {
    const longer = lines[lines.length - 1] ? `${lines[lines.length - 1]} ${word}` : word;
    if (longer.length * LETTER <= pixels || !lines[lines.length - 1]) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}

function writeLines(lines, attributes, svg) {
  lines.forEach((line, i) => { element("text", {...attributes, y: attributes.y + i * LINE}, svg).textContent = line; });
}

const spell = (x) => String(Number(x.toPrecision(6)));

// chart: {x, y, xName, yName, lines: [{x, y, look, name}], band: [low, high] or null, levels: [{y, look, name}]}.
// `x` and `y` are where the run is in each frame; choose(frame) is called when the reader points at one of them.
function makeChart(host, legend, chart, label, choose) {
  let now = 0, scale = null, marker = null, svg = null;
  const all = (key) => [...chart.lines.flatMap((line) => line[key]), ...chart[key]].filter(Number.isFinite);
  const range = (values) => {
    let low = 0, high = 0;
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    if (high === low) high = low + 1;
    return [low < 0 ? low - 0.04 * (high - low) : 0, high + 0.06 * (high - low)];
  };
  const spanX = range(all("x")), spanY = range([...all("y"), ...chart.levels.map((level) => level.y), ...(chart.band || [])]);

  function draw() {
    const wide = Math.max(260, host.clientWidth), high = Math.min(340, Math.max(220, 0.58 * wide));
    const names = {x: wrapped(chart.xName, wide - MARGIN.left - MARGIN.right), y: wrapped(chart.yName, high - MARGIN.top - MARGIN.bottom)};
    const left = MARGIN.left + LINE * (names.y.length - 1), bottom = MARGIN.bottom + LINE * (names.x.length - 1);
    host.replaceChildren();
    svg = element("svg", {viewBox: `0 0 ${wide} ${high}`, height: high, role: "img", "aria-label": label}, host);
    scale = {
      x: (x) => left + (x - spanX[0]) / (spanX[1] - spanX[0]) * (wide - left - MARGIN.right),
      y: (y) => high - bottom - (y - spanY[0]) / (spanY[1] - spanY[0]) * (high - MARGIN.top - bottom),
    };
    for (const x of ticks(...spanX, wide / 90)) {
      element("line", {class: "grid", x1: scale.x(x), x2: scale.x(x), y1: MARGIN.top, y2: high - bottom}, svg);
      element("text", {x: scale.x(x), y: high - bottom + 16, "text-anchor": "middle"}, svg).textContent = spell(x);
    }
    for (const y of ticks(...spanY, high / 50)) {
      element("line", {class: "grid", x1: left, x2: wide - MARGIN.right, y1: scale.y(y), y2: scale.y(y)}, svg);
      element("text", {x: left - 6, y: scale.y(y) + 4, "text-anchor": "end"}, svg).textContent = spell(y);
    }
    element("path", {class: "axis", d: `M${left} ${MARGIN.top}V${high - bottom}H${wide - MARGIN.right}`}, svg);
    const across = (wide + left - MARGIN.right) / 2, middle = (high - bottom + MARGIN.top) / 2;
    writeLines(names.x, {x: across, y: high - bottom + 34, "text-anchor": "middle"}, svg);
    writeLines(names.y, {x: 14, y: middle, "text-anchor": "middle", transform: `rotate(-90 14 ${middle})`}, svg);
    if (chart.band) {
      const [low, top] = chart.band.map(scale.y);
      element("rect", {class: "band", x: left, width: wide - left - MARGIN.right, y: top, height: Math.max(low - top, 0.5)}, svg);
    }
    for (const level of chart.levels)
      element("line", {class: `line ${level.look}`, x1: left, x2: wide - MARGIN.right, y1: scale.y(level.y), y2: scale.y(level.y)}, svg);
    for (const line of chart.lines) {
      const d = line.x.map((x, i) => (Number.isFinite(x) && Number.isFinite(line.y[i]) ? `${i ? "L" : "M"}${scale.x(x).toFixed(2)} ${scale.y(line.y[i]).toFixed(2)}` : "")).join("");
      if (d) element("path", {class: `line ${line.look}`, d: d.replace(/^L/, "M")}, svg);
    }
    marker = element("circle", {class: "now", r: 6.5}, svg);
    svg.addEventListener("pointerdown", (event) => point(event, true));
    svg.addEventListener("pointermove", (event) => { if (event.pointerType === "mouse" || event.buttons) point(event, event.buttons > 0); });
    place();
  }

  // The frame nearest to the pointer; with `anywhere`, however far that is.
  function point(event, anywhere) {
    const box = svg.getBoundingClientRect(), factor = svg.viewBox.baseVal.width / box.width;
    const x = (event.clientX - box.left) * factor, y = (event.clientY - box.top) * factor;
    let best = -1, least = anywhere ? Infinity : NEAR_ENOUGH;
    chart.x.forEach((value, i) => {
      const far = Math.hypot(scale.x(value) - x, scale.y(chart.y[i]) - y);
      if (far < least) { least = far; best = i; }
    });
    if (best >= 0) choose(best, anywhere);
  }

  function place() {
    const i = Math.min(Math.floor(now), chart.x.length - 1), next = Math.min(i + 1, chart.x.length - 1), share = now - i;
    marker.setAttribute("cx", scale.x(chart.x[i] + share * (chart.x[next] - chart.x[i])));
    marker.setAttribute("cy", scale.y(chart.y[i] + share * (chart.y[next] - chart.y[i])));
  }

  const named = [...chart.lines, ...chart.levels].filter((line) => line.name);
  if (chart.band) named.push({look: "band", name: chart.bandName});
  for (const line of named) {
    const entry = document.createElement("span"), sample = element("svg", {width: 26, height: 10, "aria-hidden": "true"}, entry);
    if (line.look === "band") element("rect", {class: "band", width: 26, height: 8, y: 1}, sample);
    else element("line", {class: `line ${line.look}`, x1: 0, x2: 26, y1: 5, y2: 5}, sample);
    entry.append(line.name);
    legend.append(entry);
  }
  let width = 0;
  const watch = new ResizeObserver(() => { if (host.clientWidth !== width) { width = host.clientWidth; draw(); } });
  watch.observe(host);
  width = host.clientWidth;
  draw();
  return {
    show(frame) { now = frame; place(); },
    remove() { watch.disconnect(); host.replaceChildren(); legend.replaceChildren(); },
  };
}
