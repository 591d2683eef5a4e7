// Ties the slider, the blocks and the diagrams together: whatever moves one of them moves all.

(function () {
  const data = JSON.parse(document.getElementById("data").textContent), frames = data.time.length;
  const find = (id) => document.getElementById(id);
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const slider = find("time"), stretch = find("magnification"), play = find("play"), views = [];
  let frame = 0, playing = false, last = 0;

  function between(values) { // the value at the fractional frame number; null where either end is missing
    return (f) => {
      const i = Math.min(Math.floor(f), frames - 1), next = Math.min(i + 1, frames - 1);
      const low = values[i], high = values[next];
      return low === null || high === null ? null : low + (f - i) * (high - low);
    };
  }

  const magnification = () => 10 ** Number(stretch.value), shown = data.readout.map((item) => between(item.values));

  function show(newFrame) {
    frame = Math.min(Math.max(newFrame, 0), frames - 1);
    slider.value = String(Math.round(frame));
    const words = data.readout.map((item, i) => {
      const value = shown[i](frame);
      return value === null ? "" : `${item.name} ${Number(value.toPrecision(item.digits))} ${item.unit}`.trim();
    }).filter(Boolean);
    find("readout").textContent = words.join(", ");
    slider.setAttribute("aria-valuetext", `frame ${Math.round(frame) + 1} of ${frames}: ${words.join(", ")}`);
    const times = magnification();
    find("times").textContent = times < 1.005 ? "true scale" : `× ${Number(times.toPrecision(3))}`;
    for (const view of views) view(frame, times);
  }

  function pause() {
    playing = false;
    play.setAttribute("aria-pressed", "false");
    play.setAttribute("aria-label", "Play the motion");
    find("play-shape").setAttribute("d", "M3 1l11 7-11 7z");
  }

  function start() {
    playing = true;
    last = 0;
    if (frame >= frames - 1) frame = 0;
    play.setAttribute("aria-pressed", "true");
    play.setAttribute("aria-label", "Stop the motion");
    find("play-shape").setAttribute("d", "M3 1h4v14H3zM9 1h4v14H9z");
    requestAnimationFrame(step);
  }

  function step(time) {
    if (!playing) return;
    const pace = Math.max(frames / 8000, 0.004); // frames a millisecond: the whole motion takes eight seconds at most
    const next = last ? frame + pace * (time - last) : frame;
    last = time;
    show(next);
    if (frame >= frames - 1) pause();
    else requestAnimationFrame(step);
  }

  function choose(index, firmly) {
    if (firmly) pause();
    if (!playing) show(index);
  }

  function viewer() {
    const numbers = (name, type) => new type(bytes(data.blocks[name]));
    const vertexStart = numbers("vertexStart", Uint32Array), blockOf = new Uint32Array(vertexStart[data.blocks.count]);
    for (let b = 0; b < data.blocks.count; b++) blockOf.fill(b, vertexStart[b], vertexStart[b + 1]);
    const loads = data.load && between(data.load);
    const most = data.load ? Math.max(...data.load.map((x) => Math.abs(x || 0)), 1e-300) : 1;
    const centres = data.centre && [0, 1, 2].map((i) => between(data.centre.places.map((place) => place && place[i])));
    const scene = {
      blocks: data.blocks.count, frames, fixed: data.blocks.fixed, vertexStart, blockOf,
      vertices: numbers("vertices", Float32Array), faces: numbers("faces", Uint32Array), places: numbers("places", Float32Array),
      displacement: numbers("displacement", Float32Array), rotation: numbers("rotation", Float32Array),
      reach: data.reach, most: data.most, actuators: data.actuators, loads: data.loads, ties: data.ties, centre: data.centre,
      loadAt: (f) => (loads ? (loads(f) || 0) / most : 0),
      centreAt(f) {
        const place = centres && centres.map((at) => at(f));
        return place && !place.includes(null) ? place : null;
      },
    };
    const made = makeViewer(find("view"), scene);
    for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => made.look(button.dataset.view));
    views.push(made.show);
    data.colours.forEach((colour, i) => addOption("colour", colour.name, i));
    const paint = () => {
      const colour = data.colours[Number(find("colour").value)];
      made.paint(colour.name === "displacement" ? null : {values: colour.values && new Float32Array(bytes(colour.values)), most: colour.most});
      find("scale-high").textContent = colour.text;
      find("ramp").hidden = find("scale-low").hidden = !colour.text;
    };
    find("colour").addEventListener("change", paint);
    paint();
  }

  function addOption(select, text, value) {
    const option = document.createElement("option");
    option.value = String(value);
    option.textContent = text;
    find(select).append(option);
  }

  const charts = {};
  function showChart(name, chart) {
    if (charts[name]) charts[name].remove();
    find(`${name}-title`).textContent = chart.title;
    charts[name] = makeChart(find(name), find(`${name}-legend`), chart, chart.title, choose);
    charts[name].show(frame);
  }

  // The record as CSV: time, load and displacement, and what the chosen joint carries.
  function asCsv() {
    const joint = data.joints.length ? data.joints[Number(find("joint").value)] : null;
    const columns = [...data.record.columns, ...(joint ? joint.columns : [])];
    const values = columns.map((column) => new Float64Array(bytes(column.values)));
    const quote = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const lines = [columns.map((column) => quote(column.name)).join(",")];
    for (let i = 0; i < values[0].length; i++) lines.push(values.map((column) => (Number.isNaN(column[i]) ? "" : String(column[i]))).join(","));
    return lines.join("\n") + "\n";
  }

  function download() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([asCsv()], {type: "text/csv"}));
    link.download = data.record.file;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  slider.max = String(frames - 1);
  play.hidden = slider.parentElement.hidden = frames < 2;
  stretch.max = String(data.magnification.most);
  stretch.value = String(data.magnification.start);
  find("scale-high").textContent = data.mostText;
  slider.addEventListener("input", () => { pause(); show(Number(slider.value)); });
  stretch.addEventListener("input", () => show(frame));
  play.addEventListener("click", () => (playing ? pause() : start()));
  for (const name of ["curve", "path"]) {
    if (!data[name]) { find(`${name}-figure`).hidden = true; continue; }
    showChart(name, data[name]);
    views.push((newFrame) => charts[name].show(newFrame));
  }
  find("curve-figure").parentElement.hidden = !data.curve && !data.path;
  data.joints.forEach((joint, i) => addOption("joint", joint.name, i));
  find("joint-choice").hidden = data.joints.length < 2;
  find("joint").addEventListener("change", () => showChart("path", data.joints[Number(find("joint").value)].chart || data.path));
  find("download").hidden = !data.record;
  find("download").addEventListener("click", download);
  try {
    viewer();
  } catch (error) {
    find("no-view").textContent = error.message;
    find("no-view").hidden = false;
    find("scale").hidden = true;
  }
  show(data.shown);
})();
