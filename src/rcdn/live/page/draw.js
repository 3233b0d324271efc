// What lies over the picture: the board as it was found, a pale board where it is wanted, an arrow from one to the other.

const DARK = "rgb(0 0 0 / .75)", GHOST = "rgb(255 255 255 / .95)", PALE = "rgb(255 255 255 / .28)", SHADE = "rgb(20 40 70 / .28)";
const FOUND = "#ffb020", NEAR = "#3ddc84", POINTER = "#ffe14d";
const CELLS = [8, 5]; // of the pale board, the longer way first

export class Overlay {
  constructor(canvas) { this.canvas = canvas; }

  // `look`, `wanted` in px of a frame of `size`; the canvas shows the whole frame, as large as fits.
  draw(size, look, wanted) {
    const { canvas } = this, dense = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * dense), height = Math.round(canvas.clientHeight * dense);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const pen = canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, width, height);
    if (!size) return;
    const scale = Math.min(width / size[0], height / size[1]);
    const left = (width - scale * size[0]) / 2, top = (height - scale * size[1]) / 2;
    const place = ([x, y]) => [left + (x + 0.5) * scale, top + (y + 0.5) * scale];
    const unit = dense * Math.max(1, Math.min(canvas.clientWidth / 640, 2));
    if (wanted) ghost(pen, wanted.map(place), unit);
    if (look?.board) board(pen, look.board.map(place), look.grid, colour(look), unit);
    if (wanted && look?.arrow) arrow(pen, ...look.arrow.map(place), unit);
  }
}

function colour(look) {
  return !look.refused && (look.take || look.fit > 0.8) ? NEAR : FOUND;
}

function board(pen, xy, grid, ink, unit) {
  const at = new Map(grid.map(([i, j], k) => [i * 4096 + j, k]));
  pen.beginPath();
  grid.forEach(([i, j], k) => {
    for (const next of [(i + 1) * 4096 + j, i * 4096 + j + 1]) {
      if (!at.has(next)) continue;
      pen.moveTo(...xy[k]);
      pen.lineTo(...xy[at.get(next)]);
    }
  });
  for (const [style, wide] of [[DARK, 4], [ink, 2]]) {
    pen.strokeStyle = style;
    pen.lineWidth = wide * unit;
    pen.stroke();
  }
  pen.fillStyle = ink;
  pen.beginPath();
  for (const [x, y] of xy) {
    pen.moveTo(x + 3 * unit, y);
    pen.arc(x, y, 3 * unit, 0, 7);
  }
  pen.fill();
}

function ghost(pen, corners, unit) {
  const side = (k) => Math.hypot(corners[k][0] - corners[(k + 1) % 4][0], corners[k][1] - corners[(k + 1) % 4][1]);
  const upright = side(0) + side(2) < side(1) + side(3);
  const [cols, rows] = upright ? CELLS.toReversed() : CELLS;
  const to = onto(corners);
  for (let j = 0; j < rows; j++) {
    for (let i = 0; i < cols; i++) {
      pen.fillStyle = (i + j) % 2 ? PALE : SHADE;
      line(pen, [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(([x, y]) => to(x / cols, y / rows)));
      pen.fill();
    }
  }
  line(pen, corners);
  pen.lineJoin = "round";
  pen.strokeStyle = DARK;
  pen.lineWidth = 6 * unit;
  pen.stroke();
  pen.setLineDash([12 * unit, 7 * unit]);
  pen.strokeStyle = GHOST;
  pen.lineWidth = 3 * unit;
  pen.stroke();
  pen.setLineDash([]);
}

function line(pen, points) {
  pen.beginPath();
  points.forEach((p, k) => k ? pen.lineTo(...p) : pen.moveTo(...p));
  pen.closePath();
}

// The perspective map of the unit square onto a quadrangle (4 corners in order around).
function onto([a, b, c, d]) {
  const sx = a[0] - b[0] + c[0] - d[0], sy = a[1] - b[1] + c[1] - d[1];
  const ux = b[0] - c[0], uy = b[1] - c[1], vx = d[0] - c[0], vy = d[1] - c[1], area = ux * vy - uy * vx || 1e-9;
  const g = (sx * vy - sy * vx) / area, h = (ux * sy - uy * sx) / area;
  return (u, v) => {
    const w = g * u + h * v + 1;
    return [0, 1].map((k) => ((b[k] - a[k] + g * b[k]) * u + (d[k] - a[k] + h * d[k]) * v + a[k]) / w);
  };
}

function arrow(pen, from, to, unit) {
  const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy);
  if (length < 12 * unit) return;
  const [x, y] = [dx / length, dy / length], head = Math.min(26 * unit, length / 2), neck = [to[0] - x * head, to[1] - y * head];
  for (const [style, more] of [[DARK, 4 * unit], [POINTER, 0]]) {
    pen.strokeStyle = pen.fillStyle = style;
    pen.lineWidth = 9 * unit + more;
    pen.lineCap = "round";
    pen.beginPath();
    pen.moveTo(...from);
    pen.lineTo(...neck);
    pen.stroke();
    pen.lineWidth = more;
    line(pen, [to, [neck[0] - y * head * .7, neck[1] + x * head * .7], [neck[0] + y * head * .7, neck[1] - x * head * .7]]);
    pen.fill();
    if (more) pen.stroke();
  }
}
