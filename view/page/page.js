// The live view's page: socket, controls, panels, time line and saved pictures. scene.js draws the 3D view.

import { isDrawnBySoftware, isNarrow, paint, Scene } from "./scene.js";

const TICK_MICROSECONDS = 0.5, PERIOD_TICKS = 50;
const SEND_MS = 1000 / 60, RECONNECT_MS = 1000, KEEP_OURS_MS = 700, NOTICE_MS = 8000, FILM_MS = 1000 / 30;
const FILM_PART_MS = 200, FILM_PATIENCE = 15, FILM_HEADER = 1000; // bytes: without a picture it is smaller
const MOST_WATCHED = 8, WAVE_HEIGHT = 26, BAR = { width: 12, high: 160, low: 76, top: 62, wide: 156, narrow: 92 };
const UNITS = { mm: 1000, "%": 100 };
const NEW_OBJECT = { x: 0, y: 0, z: 0.17, size: 0.08, rotation: 0 };
const LOST = "Connection lost";
const OFF = ": the outputs are turned off when no page is open, unless the command said --unwatched";
const NEEDED = {
  setup: ["device", "controls", "colours", "methods", "followed", "quantities", "object_kinds", "faults", "limits"], settings: ["values"],
  objects: ["count"], frame: ["seconds", "state", "sides", "planes", "scale", "boards", "figures"], notice: ["text"],
};
const ARRAYS = { u1: Uint8Array, u4: Uint32Array, f4: Float32Array };

const [token, ...parameters] = location.hash.slice(1).split("&");
const saving = new URLSearchParams(parameters.join("&"));
const page = (window.phasewire = {
  drawn: 0, received: 0, frame: null, settings: {}, setup: null, project: (place) => scene.project(place),
});

const byId = (id) => document.getElementById(id);
const all = (selector) => [...document.querySelectorAll(selector)];
const element = (tag, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};
const pause = (ms) => new Promise((done) => { setTimeout(done, ms); });
const say = (target, text) => { if (target.textContent !== text) target.textContent = text; };
const has = (group) => page.setup?.controls.includes(group) ?? false;
const clamp = (value, least, most) => Math.min(most, Math.max(least, value));
const isPlain = (value) => value === 0 || (Math.abs(value) >= 0.01 && Math.abs(value) < 1e4);
const short = (value) => (isPlain(value) ? String(Number(value.toPrecision(3))) : value.toExponential(1));

// Messages

let socket, opened = false, stopWanted = false, fresh = null, colours = {}, maps = null;

function decode(data) {
  const length = new DataView(data).getUint32(0, true);
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const missing = NEEDED[json.kind]?.filter((name) => json[name] == null) ?? ["a known kind"];
  if (missing.length) throw new Error(`${json.kind} lacks ${missing.join(", ")}`);
  const arrays = Object.entries(json.arrays ?? {}).map(([name, { type, shape, at }]) => {
    const count = shape.reduce((product, size) => product * size, 1);
    return [name, Object.assign(new ARRAYS[type](data, 4 + length + at, count), { shape })];
  });
  return { json, message: { ...json, arrays: Object.fromEntries(arrays) } };
}

function receive(data) {
  let kind = "frame";
  try {
    const { json, message } = decode(data);
    kind = json.kind;
    TAKE[kind](message, json);
  } catch (error) {
    notice(`A message of the server cannot be used: ${error.message}`, true);
  } finally {
    if (kind === "frame") socket.send("ack");
  }
}

const TAKE = {
  setup(message, json) {
    page.setup = json;
    maps = message.arrays;
    setTheme(document.documentElement.dataset.theme);
    scene?.setUp(message);
    showSetup(json);
  },
  settings({ values }) {
    page.settings = values;
    showSettings();
  },
  objects(message) {
    scene?.setObjects(message);
  },
  frame(message, json) {
    page.received += 1;
    page.frame = json;
    fresh = message;
    if (scene) scene.redraw();
    else requestAnimationFrame(showFresh);
  },
  notice({ text, error }) {
    notice(text, error);
  },
};

function connect() {
  const url = new URL("ws", location.href.split("#")[0]);
  url.protocol = url.protocol.replace("http", "ws");
  url.search = `?token=${token}`;
  socket = new WebSocket(url);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    opened = true;
    say(byId("lost"), "");
    if (stopWanted) stop();
  };
  socket.onmessage = ({ data }) => receive(data);
  socket.onclose = () => {
    say(byId("lost"), opened ? LOST + (has("stop") ? OFF : "") : "No connection: open the URL that the program printed");
    showState("lost");
    setTimeout(connect, RECONNECT_MS);
  };
}

function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  else notice("Not connected: the change was not sent", true);
}

function stop() {
  stopWanted = socket?.readyState !== WebSocket.OPEN;
  if (stopWanted) notice("Not connected: STOP is sent when the connection is back", true);
  else send({ do: "stop" });
  if (read("at") != null) set({ at: null });
}

function notice(text, error = false) {
  const list = byId("notices");
  const same = [...list.children].find((child) => child.textContent === text);
  const shown = same ?? element("p", { textContent: text, className: error ? "error" : "" });
  if (!same) list.append(shown);
  while (list.children.length > 4) list.firstChild.remove();
  clearTimeout(shown.timer);
  shown.timer = setTimeout(() => shown.remove(), NOTICE_MS);
}

// Settings: those of the server, and for a moment our own changes on top of them

let ours = {}, unsent = {}, sendTimer, oursTimer, lastSent = 0, selected = 0;
const controls = [];

const current = () => ({ ...page.settings, ...ours });

function set(values) {
  Object.assign(ours, values);
  Object.assign(unsent, values);
  clearTimeout(oursTimer);
  oursTimer = setTimeout(() => {
    ours = {};
    showSettings();
  }, KEEP_OURS_MS);
  sendTimer ??= setTimeout(sendSettings, Math.max(0, lastSent + SEND_MS - performance.now()));
  showSettings();
}

function sendSettings() {
  send({ set: unsent });
  unsent = {};
  sendTimer = undefined;
  lastSent = performance.now();
}

function read(path) {
  const [name, key] = path.split(".");
  const value = current()[name];
  if (key === undefined) return value;
  return name === "objects" ? value?.[selected]?.[key] : value?.[key];
}

function change(path, value) {
  const [name, key] = path.split(".");
  const now = current()[name];
  if (key === undefined) set({ [name]: value });
  else if (name === "objects") changeObject(selected, { [key]: value });
  else set({ [name]: Array.isArray(now) ? now.with(Number(key), value) : { ...now, [key]: value } });
}

function changeObject(which, values) {
  set({ objects: current().objects.map((object, k) => (k === which ? { ...object, ...values } : object)) });
}

function isBusy(input) {
  return input.matches(":active") || (input === document.activeElement && ["text", "number"].includes(input.type));
}

function showSettings() {
  controls.filter(({ input }) => !isBusy(input)).forEach((control) => control.show());
  showObjects();
  scene?.mark(current());
}

function makeSlider(place) {
  const { slider: path, unit = "", step = "1", range } = place.dataset;
  const times = UNITS[unit] ?? 1;
  const label = element("label", { textContent: place.textContent, htmlFor: path });
  const input = element("input", { type: "range", id: path, step });
  const output = element("span");
  place.classList.add("slider");
  place.replaceChildren(label, input, output);
  const tell = () => {
    say(output, `${Number(input.value)} ${unit}`);
    input.ariaValueText = output.textContent;
  };
  input.addEventListener("input", () => {
    change(path, Number(input.value) / times);
    tell();
  });
  controls.push({
    input,
    setUp({ limits }) {
      const [least, most] = limits[path] ?? range.split(" ").map(Number);
      Object.assign(input, { min: least * times, max: most * times });
    },
    show() {
      const followed = path === "xy_at" && read("follow");
      const value = followed ? page.frame?.planes.find(({ name }) => name === "xy")?.corner[2] ?? read(path) : read(path);
      input.disabled = value === undefined || Boolean(followed);
      if (value !== undefined) input.value = value * times;
      tell();
    },
  });
}

function bindControl(input) {
  const path = input.dataset.set;
  const isCheck = input.type === "checkbox";
  input.addEventListener("change", () => change(path, isCheck ? input.checked : input.value || null));
  controls.push({
    input,
    show() {
      if (isCheck) input.checked = Boolean(read(path));
      else input.value = read(path) ?? "";
    },
  });
}

function bind(id, show, onChange) {
  const input = byId(id);
  input.addEventListener(input.type === "range" ? "input" : "change", () => onChange(input));
  controls.push({ input, show: () => show(input) });
}

function setOptions(select, values, labels = values) {
  select.replaceChildren(...values.map((value, k) => element("option", { value, textContent: labels[k] })));
}

function showSetup(setup) {
  say(byId("device"), setup.device);
  all("[data-group]").forEach((part) => { part.hidden = !has(part.dataset.group); });
  byId("stop").hidden = !has("stop");
  byId("running").hidden = !has("recording");
  byId("picked").max = setup.arrays.positions.shape[0] - 1;
  setOptions(byId("quantity"), setup.quantities.map(({ name }) => name), setup.quantities.map(({ label }) => label));
  setOptions(byId("method"), setup.methods);
  setOptions(byId("compare"), ["", ...setup.methods], ["nothing", ...setup.methods]);
  setOptions(byId("follow"), ["", ...setup.followed], ["nothing", ...setup.followed.map((what) => `the ${what}`)]);
  setOptions(byId("objects.kind"), setup.object_kinds);
  setOptions(byId("fault-name"), setup.faults.map(({ name }) => name));
  showFaultFields();
  controls.forEach((control) => control.setUp?.(setup));
  selectObject(selected);
}

// Controls that are no plain setting

function bindControls() {
  all("[data-slider]").forEach(makeSlider);
  all("[data-set]").forEach(bindControl);
  bind("automatic", (input) => { input.checked = read("scale") === null; },
    (input) => set({ scale: input.checked ? null : page.frame?.scale.largest ?? 1 }));
  bind("scale", showScale, (input) => set({ scale: 10 ** Number(input.value) }));
  bind("probing", (input) => { input.checked = Boolean(read("probe")); },
    (input) => set({ probe: input.checked ? [0, 0, read("xy_at")] : null }));
  bind("picked", (input) => { input.value = read("pick") ?? ""; },
    (input) => set({ pick: input.value === "" ? null : Number(input.value) }));
  bind("silence", showSilence, (input) => {
    const others = read("silenced").filter((each) => each !== read("pick"));
    set({ silenced: input.checked ? [...others, read("pick")] : others });
  });
  bind("watched", (input) => { input.value = (read("watched") ?? []).join(", "); },
    (input) => watch((input.value.match(/\d+/g) ?? []).map(Number)));
  bind("object", () => {}, (input) => selectObject(Number(input.value)));
  bind("at", () => {}, (input) => set({ at: Number(input.value) }));
  bindButtons();
}

function bindButtons() {
  const clicks = {
    stop, go: () => send({ do: "go" }), theme: () => setTheme(isDark() ? "light" : "dark"),
    closer: () => scene.zoom(true), farther: () => scene.zoom(false), live: () => set({ at: null }),
    running: () => set({ running: !read("running") }), watch: () => watch([...read("watched"), read("pick")]),
    add: addObject, remove: removeObject, "clear-faults": () => send({ do: "clear-faults" }),
    "save-picture": async () => download(await makePicture(), "png"), record: async () => download(await makeFilm(5), "webm"),
  };
  Object.entries(clicks).forEach(([id, click]) => byId(id).addEventListener("click", click));
  all("[data-view]").forEach((button) => button.addEventListener("click", () => scene.lookFrom(button.dataset.view)));
  all("[data-periods]").forEach((button) => button.addEventListener("click", () => step(Number(button.dataset.periods))));
  byId("fault-name").addEventListener("change", showFaultFields);
  byId("fault").addEventListener("submit", injectFault);
}

function showScale(input) {
  const { largest = 1, unit = "" } = page.frame?.scale ?? {};
  const value = read("scale") ?? largest;
  const power = Math.log10(Math.max(1e-9, value));
  if (!isBusy(input)) {
    if (!(power > input.min && power < input.max)) Object.assign(input, { min: power - 2, max: power + 2 });
    input.disabled = read("scale") === null;
    input.value = power;
  }
  input.ariaValueText = `${short(value)} ${unit.replace(/ \(.*\)/, "")}`;
  say(byId("largest"), input.ariaValueText);
}

function showSilence(input) {
  input.disabled = read("pick") == null;
  byId("watch").disabled = input.disabled;
  input.checked = (read("silenced") ?? []).includes(read("pick"));
}

function watch(transducers) {
  set({ watched: [...new Set(transducers)].slice(-MOST_WATCHED) });
  byId("waves-panel").open = true;
}

function selectObject(which) {
  selected = which;
  scene?.select(has("objects") ? which : -1);
  showSettings();
}

function showObjects() {
  const kinds = (current().objects ?? []).map(({ kind }, k) => `${k + 1}: ${kind}`);
  const chooser = byId("object");
  if (kinds.join() !== [...chooser.options].map(({ text }) => text).join()) setOptions(chooser, kinds.map((_, k) => k), kinds);
  if (selected >= kinds.length && selected > 0) selectObject(Math.max(0, kinds.length - 1));
  chooser.value = selected;
  byId("shape").disabled = byId("remove").disabled = kinds.length === 0;
}

function addObject() {
  const objects = [...(current().objects ?? []), { ...NEW_OBJECT, kind: page.setup.object_kinds[0] }];
  set({ objects });
  selectObject(objects.length - 1);
}

function removeObject() {
  set({ objects: current().objects.filter((_, k) => k !== selected) });
}

function showFaultFields() {
  const fault = page.setup.faults.find(({ name }) => name === byId("fault-name").value);
  byId("fault-fields").replaceChildren(...(fault?.fields ?? []).map((field) =>
    element("div", { className: "row" },
      element("label", { htmlFor: `fault.${field.name}`, textContent: field.name }), faultInput(field))));
}

function faultInput({ name, least, most, whole, optional, values, default: given }) {
  const id = `fault.${name}`;
  if (values) {
    const select = element("select", { id, name });
    setOptions(select, optional ? ["", ...values] : values);
    select.value = given ?? select.options[0].value;
    return select;
  }
  return element("input", {
    id, name, type: "number", min: least ?? "", max: most ?? "", step: whole ? 1 : "any", required: !optional,
    value: given ?? (optional ? "" : least ?? 0), placeholder: optional ? "none" : "",
  });
}

function injectFault(event) {
  event.preventDefault();
  const given = all("#fault-fields .row > :last-child").filter(({ value }) => value !== "")
    .map(({ name, type, value }) => [name, type === "number" ? Number(value) : value]);
  send({ do: "fault", fault: { name: byId("fault-name").value, ...Object.fromEntries(given) } });
}

function step(periods) {
  const { period, oldest, newest } = page.frame;
  set({ at: clamp((read("at") ?? period) + periods, oldest, newest) });
}

// Frames

let faults = [];

function showFresh() {
  const frame = fresh;
  fresh = null;
  if (!frame) return;
  try {
    scene?.show(frame);
    showFrame(frame);
  } catch (error) {
    notice(`A frame of the server cannot be shown: ${error.message}`, true);
  }
}

function showFrame(frame) {
  showState(frame.state, frame.live);
  say(byId("source"), frame.source);
  showPairs(byId("figures"), frame.figures);
  showPairs(byId("pick"), frame.pick?.lines ?? []);
  showTime(frame);
  showProbe(frame.probe);
  showWaves(frame);
  showSide(frame);
  drawLegend(frame.scale);
  showFaults(frame.boards);
  showScale(byId("scale"));
  if (read("follow")) controls.find(({ input }) => input.id === "xy_at").show();
  describe(frame);
}

function showState(state, live = true) {
  const lost = socket.readyState !== WebSocket.OPEN;
  say(byId("state"), lost ? "no connection" : live ? state : `past: ${state}`);
  byId("state").dataset.state = lost ? "lost" : live ? state : "past";
  byId("go").hidden = lost || state !== "stopped" || !has("play");
}

function showPairs(list, pairs) {
  while (list.children.length > pairs.length) list.lastChild.remove();
  pairs.forEach(([label, text], k) => {
    const row = list.children[k] ?? list.appendChild(element("div", {}, element("dt"), element("dd")));
    say(row.firstChild, label);
    say(row.lastChild, text);
  });
}

function showTable(table, rows) {
  const text = JSON.stringify(rows);
  if (table.text === text) return;
  table.text = text;
  table.replaceChildren(...rows.map(([label, ...cells]) =>
    element("tr", {}, element("th", { scope: "row", textContent: label }),
      ...cells.map((textContent) => element("td", { textContent })))));
}

function showTime({ seconds, period, live, oldest, newest }) {
  const slider = byId("at");
  byId("time").hidden = !has("past") || oldest === null;
  if (!isBusy(slider)) Object.assign(slider, { min: oldest ?? 0, max: newest ?? 0, value: period });
  say(byId("seconds"), `${seconds.toFixed(6)} s`);
  if (slider === document.activeElement) slider.ariaValueText = byId("seconds").textContent;
  byId("live").ariaPressed = String(live);
  say(byId("running"), read("running") ? "Pause" : "Play");
}

function showProbe(probe) {
  const halves = probe?.pascals.map((pascals, k) => [
    probe.pascals.length > 1 ? `Half ${k}` : "", `${short(pascals)} Pa`,
    `${probe.decibels[k].toFixed(1)} dB`, `${probe.degrees[k].toFixed(0)}°`,
  ]);
  showTable(byId("probe"), halves ?? []);
}

function showFaults(boards) {
  boards.forEach((fault, board) => { if (fault && fault !== faults[board]) notice(`board ${board}: ${fault}`, true); });
  faults = boards;
}

function describe({ planes, sides, boards, arrays }) {
  const parts = [`${arrays.phase.length} transducers on ${boards.length} boards`, ...sides.map((side) => `${side} hand`),
    planes.length ? `field in ${planes.map(({ name }) => name).join(", ")}` : "no field"];
  const label = `3D view: ${parts.join(", ")}. Arrow keys turn it, plus and minus zoom.`;
  if (byId("scene").ariaLabel !== label) byId("scene").ariaLabel = label;
}

// Pictures beside the scene

function prepare(canvas, width, height) {
  const ratio = Math.min(2, window.devicePixelRatio);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    canvas.style.height = `${height}px`;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = colours.ink;
  context.textBaseline = "alphabetic";
  return context;
}

function showWaves({ waves, arrays }) {
  const canvas = byId("waves");
  canvas.hidden = !waves?.names.length;
  if (canvas.hidden || !byId("waves-panel").open) return;
  const values = arrays.waves, [ticks, outputs] = values.shape;
  const width = canvas.clientWidth, height = outputs * WAVE_HEIGHT + 30;
  const context = prepare(canvas, width, height);
  const left = 8 + Math.max(...waves.names.map((name) => context.measureText(name).width));
  const x = (tick) => left + (tick / ticks) * (width - left - 6);
  drawTimes(context, waves.first, ticks, x, height);
  waves.names.forEach((name, k) => {
    const low = (k + 1) * WAVE_HEIGHT - 4;
    context.fillStyle = colours.ink;
    context.fillText(name, 0, low - 5);
    context.beginPath();
    for (let tick = 0; tick < ticks; tick++) {
      const y = low - (WAVE_HEIGHT - 9) * values[tick * outputs + k];
      context.lineTo(x(tick), y);
      context.lineTo(x(tick + 1), y);
    }
    context.strokeStyle = colours.accent;
    context.stroke();
  });
  canvas.ariaLabel = `Square waves of ${waves.names.join(", ")}`;
}

function drawTimes(context, first, ticks, x, height) {
  context.textAlign = "center";
  context.fillStyle = colours.dim;
  context.strokeStyle = colours.line;
  context.beginPath();
  for (let tick = 0; tick <= ticks; tick += PERIOD_TICKS) {
    context.moveTo(x(tick), 0);
    context.lineTo(x(tick), height - 26);
    context.fillText(String(tick * TICK_MICROSECONDS), x(tick), height - 14);
  }
  context.stroke();
  context.fillText(`µs after ${((first * TICK_MICROSECONDS) / 1000).toFixed(3)} ms`, x(ticks / 2), height - 2);
  context.textAlign = "left";
}

function showSide({ side, scale, arrays }) {
  byId("side").hidden = !side;
  say(byId("incomplete"), side?.incomplete ? `Comparison incomplete: ${side.incomplete}` : "");
  all("#side > :not(p)").forEach((part) => { part.hidden = Boolean(side?.incomplete); });
  if (!side || side.incomplete) return;
  const map = scale.cyclic ? maps.cyclic : maps.sequential;
  const pictures = [["this", side.method], ["other", side.other]];
  pictures.forEach(([which, method]) => {
    const canvas = byId(`${which}-plane`);
    say(byId(`${which}-name`), method);
    canvas.ariaLabel = `${scale.label} by ${method}, from above`;
    drawPlane(canvas, arrays[which], map);
  });
  showTable(byId("side-numbers"), [["", side.method, side.other], ...side.numbers]);
}

function drawPlane(canvas, values, map) {
  const [rows, columns] = values.shape;
  if (canvas.width !== columns || canvas.height !== rows) Object.assign(canvas, { width: columns, height: rows, image: null });
  const context = canvas.getContext("2d");
  canvas.image ??= context.createImageData(columns, rows);
  for (let row = 0; row < rows; row++) {
    const start = 4 * columns * (rows - 1 - row);
    paint(canvas.image.data.subarray(start, start + 4 * columns), values.subarray(columns * row, columns * (row + 1)), map);
  }
  context.putImageData(canvas.image, 0, 0);
}

function drawLegend({ label, unit, largest, cyclic }) {
  const canvas = byId("legend"), height = isNarrow(byId("stage")) ? BAR.low : BAR.high;
  const key = JSON.stringify([label, unit, largest, cyclic, colours.ink, height]);
  if (canvas.key === key) return;
  canvas.key = key;
  canvas.style.width = `${BAR.wide + BAR.narrow}px`;
  const context = prepare(canvas, BAR.wide + BAR.narrow, height + BAR.top + 10);
  const most = largest > 0 ? largest : 1;
  drawBar(context, 0, height, `${label} / ${unit}`, most, cyclic ? maps.cyclic : maps.sequential, niceStep(most, unit));
  drawBar(context, BAR.wide, height, "Drive phase / °", 360, maps.cyclic, 90);
  canvas.ariaLabel = `Colour bars: ${label} from 0 to ${short(most)} ${unit}; phase of the transducers from 0 to 360°`;
}

function niceStep(most, unit) {
  if (unit === "°") return 90;
  const power = 10 ** Math.floor(Math.log10(most / 5));
  return power * [1, 2, 5, 10].find((factor) => factor * power * 5 >= most * 0.999);
}

function wrapped(context, text, width) {
  return text.split(" ").reduce((lines, word) => {
    const longer = `${lines.at(-1)} ${word}`.trim();
    return context.measureText(longer).width <= width ? [...lines.slice(0, -1), longer] : [...lines, word];
  }, [""]);
}

function drawBar(context, left, height, title, most, map, stride) {
  const bottom = BAR.top + height;
  context.fillStyle = colours.ink;
  context.textBaseline = "middle";
  wrapped(context, title, BAR.wide - 8).reverse().forEach((line, k) => context.fillText(line, left, BAR.top - 15 - 13 * k));
  for (let k = 0; k < height; k++) {
    const from = 3 * Math.round((255 * k) / (height - 1));
    context.fillStyle = `rgb(${map.subarray(from, from + 3).join()})`;
    context.fillRect(left, bottom - 1 - k, BAR.width, 1);
  }
  context.fillStyle = colours.ink;
  for (let tick = 0; tick * stride <= most * 1.001; tick++) {
    const y = bottom - (tick * stride * height) / most;
    context.fillRect(left + BAR.width, y - 0.5, 4, 1);
    context.fillText(short(tick * stride), left + BAR.width + 8, y);
  }
}

// Saved pictures

let film = null, toSave = saving.get("save"), drawnWithData = 0;

function compose() {
  const context = film.getContext("2d"), source = byId("scene"), legend = byId("legend");
  const ratio = film.width / source.clientWidth;
  context.drawImage(source, 0, 0, film.width, film.height);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  drawLabels(context);
  context.drawImage(legend, legend.offsetLeft, legend.offsetTop, legend.clientWidth, legend.clientHeight);
  context.font = "600 14px system-ui, sans-serif";
  context.fillStyle = colours.ink;
  context.fillText(pictureTitle(), 12, 22);
  context.setTransform(1, 0, 0, 1, 0, 0);
}

function drawLabels(context) {
  context.textAlign = "center";
  context.textBaseline = "middle";
  scene.labels.forEach(({ x, y, text, kind }) => {
    context.font = `${kind === "tick" ? "" : "600 "}12px system-ui, sans-serif`;
    context.fillStyle = colours[{ tick: "axis", name: "ink", bad: "bad" }[kind]];
    context.strokeStyle = colours.scene;
    context.lineWidth = 3;
    context.strokeText(text, x, y);
    context.fillText(text, x, y);
  });
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
}

function pictureTitle() {
  const { scale, seconds } = page.frame ?? { scale: {}, seconds: 0 };
  return [page.setup?.device, scale.label, `${seconds.toFixed(4)} s`].filter(Boolean).join(" · ");
}

function startFilm() {
  const { width, height } = byId("scene");
  film = element("canvas", { width, height });
  scene.draw();
  return film;
}

async function makePicture() {
  const canvas = startFilm();
  film = null;
  return new Promise((done) => { canvas.toBlob(done, "image/png"); });
}

async function makeFilm(seconds) {
  const recorder = new MediaRecorder(startFilm().captureStream(30), { mimeType: "video/webm" });
  const parts = [], redrawing = setInterval(() => scene.redraw(), FILM_MS);
  byId("record").disabled = true;
  recorder.ondataavailable = ({ data }) => parts.push(data);
  recorder.start(FILM_PART_MS);
  const size = () => parts.reduce((sum, part) => sum + part.size, 0), last = performance.now() + 1000 * (seconds + FILM_PATIENCE);
  await pause(1000 * seconds);
  while (size() < FILM_HEADER && performance.now() < last) await pause(FILM_PART_MS); // a busy computer has drawn nothing yet
  await new Promise((done) => {
    recorder.onstop = done;
    recorder.stop();
  });
  clearInterval(redrawing);
  byId("record").disabled = false;
  film = null;
  return new Blob(parts, { type: "video/webm" });
}

function download(blob, ending) {
  const link = element("a", { href: URL.createObjectURL(blob), download: `phasewire.${ending}` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

async function saveForServer() {
  if (!toSave || !page.received || ++drawnWithData < 3) return;
  const kind = toSave;
  toSave = null;
  socket.send(await (kind === "png" ? makePicture() : makeFilm(Number(saving.get("seconds") ?? 5))));
}

// The scene

function makeScene() {
  try {
    return new Scene(byId("scene"), byId("labels"), {
      before: showFresh,
      drawn() {
        page.drawn += 1;
        if (page.frame) drawLegend(page.frame.scale); // its size is that of the window
        if (film) compose();
        if (toSave) {
          saveForServer();
          scene.redraw();
        }
      },
      movable: placeOf,
      moved: moveTo,
      select: selectObject,
      probe(place) {
        set({ probe: place });
        byId("probe-panel").open = true;
      },
      pick(transducer) {
        set({ pick: transducer });
        byId("pick-panel").open = true;
      },
    }, Boolean(toSave) || !isDrawnBySoftware());
  } catch (error) {
    notice(`The 3D view cannot be shown: ${error.message}`, true);
    return null;
  }
}

function placeOf(what) {
  const moved = what === "hand" ? has("hand") && current().hand : has("objects") && current().objects?.[what];
  return moved ? [moved.x, moved.y, moved.z] : null;
}

function moveTo(what, place) {
  const group = what === "hand" ? "hand" : "objects";
  const [x, y, z] = ["x", "y", "z"].map((axis, k) => clamp(place[k], ...(page.setup.limits[`${group}.${axis}`] ?? [-1, 1])));
  if (group === "hand") set({ hand: { ...current().hand, x, y, z } });
  else changeObject(what, { x, y, z });
}

const isDark = () => document.documentElement.dataset.theme !== "light";

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  const style = getComputedStyle(document.documentElement);
  const names = ["scene", "axis", "housing", "accent", "bad", "ink", "dim", "line"];
  colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  Object.assign(colours, { object: colours.ink }, page.setup?.colours[theme]);
  scene?.setColours(colours);
  if (page.frame) drawLegend(page.frame.scale);
  byId("theme").textContent = isDark() ? "Light" : "Dark";
  byId("theme").ariaLabel = `${byId("theme").textContent} theme`;
}

function stopByKey(event) {
  const typing = event.target.closest?.("button, summary, select, input:not([type=range])");
  if (!has("stop") || !(event.key === "Escape" || (event.key === " " && !typing))) return;
  event.preventDefault();
  if (!event.repeat) stop();
}

if (toSave) document.body.classList.add("saving");
const scene = makeScene();
const light = matchMedia("(prefers-color-scheme: light)");
bindControls();
setTheme(light.matches ? "light" : "dark");
light.addEventListener("change", () => setTheme(light.matches ? "light" : "dark"));
document.addEventListener("keydown", stopByKey, true);
connect();
