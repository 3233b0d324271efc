// The page: what the server says is shown, what the person wishes is sent.

import { Camera, cameraWords } from "./camera.js";
import { Overlay } from "./draw.js";
import { Link } from "./link.js";
import { showProgress, showResult, showViews } from "./panel.js";
import { allowSound, announce, tone } from "./voice.js";

const get = (id) => document.getElementById(id);
const BEGUN = "begun", SHOWN_FOR = 5000, STEADY = 250, KEPT = 400; // ms, and how many are kept
const STILL = "Hold still.", WAIT = "You may lower the board for a moment.";
// What shows each camera: of one, the first of both is used.
const sides = ["", "-right"].map((end) => ({ stage: get(`stage${end}`), video: get(`video${end}`), preview: get(`preview${end}`), overlay: new Overlay(get(`overlay${end}`)) }));
let state = null, look = null, running = false, begun = false, trouble = "", troubleUntil = 0, sizes = [], sought = false, two = false;

// For whoever measures: ms from a frame to what is drawn of it, and when each was drawn.
const stats = window.live = { latencies: [], shown: [], refused: 0, looks: 0 };

const link = new Link({ state: showState, look: showLook, preview: showPreview, trouble: showTrouble, up: () => banner(""), down });
const camera = new Camera(sides.map((side) => side.video), link);

// ---- what the server says

function showState(next) {
  const before = state;
  state = next;
  two = state.cameras === 2;
  if (!before) showCameras();
  if (!running) showSetup();
  if (state.size) sizes = two ? state.size : [state.size];
  showProgress(state);
  showViews(state.views, (name) => link.wish("remove", { name }), two);
  if (showResult(state.written, state.folder, two)) {
    tone(660, 880, 1320);
    announce(`${get("verdict").textContent}. The files are written.`, true);
    get("verdict").focus({ preventScroll: false });
  }
  if (before && state.views.length > before.views.length && before.views.length === state.views.length - 1) taken();
  if (state.spacing && (running || sessionStorage.getItem(BEGUN))) begin();
  say();
}

function showLook(next, time) {
  look = next;
  stats.looks++;
  if (next.refused) stats.refused++;
  if (state?.source === "browser") sizes = camera.sizes;
  requestAnimationFrame((now) => {
    const wanted = state?.busy ? null : state?.wanted, all = two ? sides : sides.slice(0, 1);
    all.forEach(({ overlay }, k) => overlay.draw(sizes[k], two ? sideOf(k) : look, two ? wanted?.[k] : wanted));
    if (time !== undefined) keep(stats.latencies, performance.now() - time);
    keep(stats.shown, now);
    rate();
  });
  say();
}

// What is said of one of two cameras; whether it is taken holds for both.
function sideOf(k) {
  return look?.sides && { ...look.sides[k], refused: look.refused, take: look.take, fit: look.fit };
}

async function showPreview(blobs, number) {
  const pictures = await Promise.all(blobs.map((blob) => createImageBitmap(blob)));
  pictures.forEach((picture, k) => {
    const canvas = sides[k].preview;
    if (canvas.width !== picture.width || canvas.height !== picture.height) Object.assign(canvas, { width: picture.width, height: picture.height });
    canvas.getContext("2d").drawImage(picture, 0, 0);
    shape(k, picture.width, picture.height);
    picture.close();
  });
  link.wish("shown", { value: number });
}

function showTrouble(text) {
  [trouble, troubleUntil] = [text, performance.now() + SHOWN_FOR];
  announce(text, true);
  if (!running) banner(text);
}

function down(replaced) {
  look = null;
  sides.forEach(({ overlay }, k) => overlay.draw(sizes[k], null, null));
  if (!replaced) return banner("The program isn't running. Start rcdn live again with the same folder: this page goes on by itself.");
  camera.stop();
  banner("This session is open in another window.", ["Use it here", () => location.reload()]);
}

// ---- what the page says

function say() {
  if (!state) return;
  const busy = state.busy, wrong = performance.now() < troubleUntil ? trouble : state.trouble;
  const { refused = "", hint = "", fit = 0 } = look ?? {}, board = look?.board ?? look?.sides?.find((side) => side.board);
  const move = board && hint && hint !== STILL; // where to hold it matters more than that it moves
  const kind = !busy && refused && !move ? "refused" : state.done || fit > 0.8 ? "good" : "";
  const words = steady(busy || (move ? hint : refused || hint) || "One moment", kind, !!busy);
  const more = busy ? WAIT : move ? (/still/.test(refused) ? "" : refused) : refused ? hint : "";
  get("hint").textContent = turned(words);
  get("sentence").textContent = turned(wrong || (more !== words && more) || state.sentence);
  get("fit-bar").style.transform = `scaleX(${fit})`;
  announce(turned(wrong ? `${wrong}. ${words}` : words));
}

// Words that last too short to be read aren't shown.
let coming = "", since = 0;
function steady(words, kind, atOnce) {
  const now = performance.now();
  if (words !== coming) [coming, since] = [words, now];
  if (atOnce || now - since >= STEADY || !get("hint").textContent) {
    get("say").className = `say ${kind}`;
    get("say").dataset.words = words;
  }
  return get("say").dataset.words ?? words;
}

// In a mirrored picture left is right.
function turned(text) {
  if (!get("mirror").checked) return text;
  return text.replace(/\b(left|right)\b/gi, (side) => {
    const other = side.toLowerCase() === "left" ? "right" : "left";
    return side[0] === side[0].toUpperCase() ? other[0].toUpperCase() + other.slice(1) : other;
  });
}

function taken() {
  tone(880, 1320);
  announce(`${two ? "Pair" : "Picture"} ${state.views.length} taken`, true);
  for (const { stage } of sides) {
    stage.classList.remove("taken");
    void stage.offsetWidth; // so that the flash begins again
    stage.classList.add("taken");
  }
}

function banner(text, action) {
  const line = get("banner");
  line.hidden = !text;
  line.textContent = text;
  if (!action) return;
  const button = document.createElement("button");
  button.textContent = action[0];
  button.addEventListener("click", action[1]);
  line.append(button);
}

function rate() {
  const recent = stats.shown.slice(-30), span = (recent.at(-1) - recent[0]) / 1000;
  if (recent.length < 10 || stats.looks % 10) return;
  const waits = stats.latencies.slice(-30).sort((a, b) => a - b), middle = waits[waits.length >> 1];
  get("rate").textContent = `${Math.round((recent.length - 1) / span)} ${two ? "pairs" : "pictures"} a second${middle ? `, ${Math.round(middle)} ms` : ""}`;
}

function keep(list, value) {
  list.push(value);
  if (list.length > KEPT) list.shift();
}

function shape(k, width, height) {
  const box = sides[k].stage;
  box.style.aspectRatio = `${width} / ${height}`;
  box.style.maxWidth = `calc((100svh - 13rem) * ${width / height})`;
}

// What the page says of two cameras instead of one.
function showCameras() {
  get("work").classList.toggle("two", two);
  if (!two) return;
  for (const name of ["stage-right", "side", "second"]) get(name).hidden = false;
  document.title = get("title").textContent = get("work-title").textContent = "Calibrate two cameras";
  get("device-words").textContent = "Left camera";
  get("sure").textContent = "How sure the cameras are";
  get("take").textContent = "Take a pair now";
  for (const name of ["video", "preview"]) get(name).setAttribute("aria-label", "What the left camera sees");
}

// ---- what the person does

function showSetup() {
  get("setup").hidden = false;
  get("folder").textContent = `, in the folder ${state.folder}`;
  get("cameras").hidden = state.source !== "browser";
  if (state.spacing && !get("spacing").value) get("spacing").value = +(state.spacing * 1000).toPrecision(9);
  get("spacing").readOnly = state.views.length > 0;
  get("go").textContent = state.views.length ? "Go on" : "Start";
  if (!sought && state.source === "browser") Camera.all().then(offer);
  sought = true;
}

function offer(cameras) {
  for (const [choice, first] of [[get("device"), 1], [get("device-right"), 2]]) {
    const chosen = choice.value, fixed = [...choice.options].slice(0, first);
    choice.replaceChildren(...fixed, ...cameras.map(([identity, name]) => new Option(name, identity)));
    choice.value = chosen;
  }
}

get("start").addEventListener("submit", (event) => {
  event.preventDefault();
  allowSound();
  sessionStorage.setItem(BEGUN, "yes");
  link.wish("begin", { value: get("spacing").valueAsNumber / 1000 });
});

async function begin() {
  if (begun) return;
  begun = running = true;
  try {
    if (state.source === "browser") {
      const chosen = ["device", "device-right"].slice(0, two ? 2 : 1).map((name) => get(name).value || (sessionStorage.getItem(name) ?? ""));
      await camera.start(chosen, chosenSize());
      ["device", "device-right"].forEach((name, k) => sessionStorage.setItem(name, chosen[k] ?? ""));
      get("mirror").checked = !two && camera.faces !== "environment" && !matchMedia("(pointer: coarse)").matches || camera.faces === "user";
      get("mirror").dispatchEvent(new Event("change"));
    }
  } catch (error) {
    begun = running = false;
    sessionStorage.removeItem(BEGUN);
    banner(cameraWords(error));
    return;
  }
  banner("");
  const server = state.source !== "browser";
  get("setup").hidden = true;
  get("work").hidden = false;
  for (const { video, preview } of sides) [video.hidden, preview.hidden] = [server, !server];
}

function chosenSize() {
  const text = sessionStorage.getItem("resolution") ?? get("resolution").value;
  return text.split("x").map(Number);
}

get("resolution").addEventListener("change", () => sessionStorage.setItem("resolution", get("resolution").value));
sides.forEach(({ video }, k) => video.addEventListener("resize", () => shape(k, ...camera.sizes[k])));
get("mirror").addEventListener("change", () => { for (const { stage } of sides) stage.classList.toggle("mirrored", get("mirror").checked); say(); });
get("take").addEventListener("click", () => { allowSound(); link.wish("take"); announce(`The next sharp ${two ? "pair" : "picture"} is taken`, true); });
get("write").addEventListener("click", () => link.wish("write"));
document.addEventListener("pointerdown", allowSound, { once: true });
