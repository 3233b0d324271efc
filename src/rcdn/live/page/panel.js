// The side of the page: how sure the camera is, where it is not, the pictures, and at the end the files.

const get = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const SURE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]; // from sure to unsure, the target in the middle
const SPAN = 4; // × the target, beyond which all is equally unsure; a part of it, below which all is equally sure
const LEVELS = {
  good: ["The camera is good", "The cameras are good"],
  fair: ["The camera is usable, with care", "The cameras are usable, with care"],
  unsure: ["The camera may be wrong", "The cameras may be wrong"],
  bad: ["Don't use this camera", "Don't use these cameras"],
};
const MAPS = ["map", "map-right", "map-between"];
const PARTS = ["Left camera", "Right camera", "From left to right"];

export function showProgress(state) {
  const { worst, target, history } = state;
  get("worst").textContent = worst === null ? "not yet known" : `± ${short(worst)} px`;
  get("goal").textContent = target === null ? "" : `goal: ${short(target)} px`;
  get("progress").value = share(worst, target, history);
  get("write").disabled = !state.views.length || !!state.busy || worst === null;
  const two = state.cameras === 2, what = two ? "cameras" : "camera";
  get("write").textContent = state.written ? `Write the ${what} again` : `Write the ${what}`;
  drawHistory(history, target);
  const maps = state.maps ?? [state.map], sizes = two ? [state.size?.[0], state.size?.[1], state.size?.[0]] : [state.size];
  MAPS.forEach((name, k) => drawMap(name, maps[k], target, sizes[k], two ? PARTS[k] : ""));
  get("map-hint").hidden = !maps[0];
}

const short = (value) => value >= 100 ? value.toFixed(0) : value.toPrecision(2);

// How far from the first uncertainty down to the target, on a scale of ratios.
function share(worst, target, history) {
  const first = history.find((w) => w !== null);
  if (worst === null || !first || !target) return Math.min(history.length, 5) * 0.02;
  if (worst <= target) return 1;
  return 0.1 + 0.85 * Math.max(0, Math.min(1, Math.log(first / worst) / Math.log(Math.max(first, 1.01 * target) / target)));
}

function drawHistory(history, target) {
  const box = get("history"), seen = history.map((w, k) => [k, w]).filter(([, w]) => w !== null);
  box.replaceChildren();
  if (!seen.length || !target) return;
  const low = Math.log(Math.min(target, ...seen.map(([, w]) => w)) * 0.8), high = Math.log(Math.max(target * 2, ...seen.map(([, w]) => w)));
  const y = (w) => (56 - 52 * (Math.log(w) - low) / (high - low)).toFixed(1);
  const goal = document.createElementNS(SVG, "line"), curve = document.createElementNS(SVG, "polyline");
  for (const [name, value] of [["x1", 0], ["x2", 300], ["y1", y(target)], ["y2", y(target)]]) goal.setAttribute(name, value);
  const last = Math.max(history.length - 1, 1);
  const points = seen.map(([k, w]) => `${(300 * k / last).toFixed(1)},${y(w)}`);
  curve.setAttribute("points", (points.length > 1 ? points : [points[0], points[0].replace(/^[^,]*/, "8")]).join(" "));
  box.append(goal, curve);
}

function drawMap(name, map, target, size, part) {
  const canvas = get(name);
  if (size) canvas.style.aspectRatio = `${size[0]} / ${size[1]}`;
  canvas.parentElement.hidden = !map;
  if (!map) return;
  Object.assign(canvas, { width: map[0].length, height: map.length });
  const pen = canvas.getContext("2d"), image = pen.createImageData(canvas.width, canvas.height);
  let most = [-1, 0, 0];
  map.forEach((row, j) => row.forEach((value, i) => {
    const unsure = value === null ? 1 : Math.max(0, Math.min(1, 0.5 + 0.5 * Math.log(value / target) / Math.log(SPAN)));
    image.data.set([...mixed(unsure), value === null && part === PARTS[2] ? 0 : 255], // what the other camera doesn't see has no value
      4 * (j * canvas.width + i));
    if (value !== null && value > most[0]) most = [value, (i + 0.5) / canvas.width, (j + 0.5) / canvas.height];
  }));
  pen.putImageData(image, 0, 0);
  const third = (v, words) => words[Math.min(2, Math.floor(3 * v))];
  const place = [third(most[2], ["upper", "", "lower"]), third(most[1], ["left", "", "right"])].filter(Boolean).join(" ") || "middle";
  canvas.setAttribute("aria-label", `${part ? `${part}: u` : "U"}ncertainty over the picture; the largest, ${short(most[0])} px, is at the ${place}`);
  get(`${name}-words`).textContent = part && `${part}: ± ${short(most[0])} px`;
}

function mixed(share) {
  const at = share * (SURE.length - 1), k = Math.min(Math.floor(at), SURE.length - 2), part = at - k;
  return SURE[k].map((v, c) => Math.round(v + part * (SURE[k + 1][c] - v)));
}

export function showViews(views, remove, two) {
  const [one, many] = two ? ["pair", "Pairs"] : ["picture", "Pictures"], One = one[0].toUpperCase() + one.slice(1);
  const list = get("views"), there = new Map([...list.querySelectorAll("li[data-name]")].map((item) => [item.dataset.name, item]));
  get("views-title").textContent = views.length ? `${many}: ${views.length}` : many;
  const items = views.map((name, k) => there.get(name) ?? picture(name, remove));
  items.forEach((item, k) => {
    item.querySelector("span").textContent = `${k + 1}`;
    item.querySelector("img").alt = `${One} ${k + 1}`;
    item.querySelector("button").setAttribute("aria-label", `Remove ${one} ${k + 1}`);
  });
  if (items.length) {
    const same = items.length === list.children.length && items.every((item, k) => item === list.children[k]);
    if (!same) list.replaceChildren(...items);
    return;
  }
  const none = document.createElement("li");
  none.className = "empty";
  none.textContent = "None yet";
  list.replaceChildren(none);
}

function picture(name, remove) {
  const item = document.createElement("li"), image = document.createElement("img"), button = document.createElement("button");
  item.dataset.name = name;
  image.src = `thumb/${encodeURIComponent(name)}`;
  image.decoding = "async";
  button.type = "button";
  button.textContent = "×";
  button.title = "Remove";
  button.addEventListener("click", () => remove(name));
  item.append(image, document.createElement("span"), button);
  return item;
}

// Shows the result; true if it has just come.
export function showResult(written, folder, two) {
  const box = get("result"), came = box.hidden && !!written;
  box.hidden = !written;
  if (!written) return false;
  box.className = `card result ${written.level}`;
  get("verdict").textContent = (LEVELS[written.level] ?? ["The camera is written", "The cameras are written"])[two ? 1 : 0];
  get("lines").replaceChildren(...written.lines.map((text) => row(text.replace(/^- /, ""))));
  get("files").replaceChildren(...written.files.map((name) => {
    const item = row(""), link = document.createElement("a"), page = name.endsWith(".html");
    link.href = `result/${encodeURIComponent(name)}`;
    link.textContent = page ? "Open the report" : name;
    if (page) Object.assign(link, { target: "_blank", rel: "noopener" });
    else link.download = name;
    item.append(link);
    return item;
  }));
  get("where").textContent = folder;
  return came;
}

function row(text) {
  const item = document.createElement("li");
  item.textContent = text;
  return item;
}
