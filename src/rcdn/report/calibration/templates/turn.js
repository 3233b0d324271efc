// Rotates the boards in space, by dragging or with the arrow keys. The projection is that of space.py's Look.
document.querySelectorAll("svg.space").forEach(function (svg) {
  var look = svg.dataset.look.split(" ").map(Number),
    c = look.slice(0, 3),
    scale = look[3],
    yaw = look[4],
    pitch = look[5],
    from = null,
    moved = false,
    mid = svg.viewBox.baseVal.width / 2,
    low = (svg.viewBox.baseVal.height - 26) / 2,
    shapes = Array.from(svg.querySelectorAll("[data-p]")).map(function (e) {
      return [e, e.dataset.p.split(" ").map(Number)];
    });
  function draw() {
    var a = (yaw * Math.PI) / 180,
      b = (pitch * Math.PI) / 180;
    shapes.forEach(function (s) {
      var p = s[1],
        out = [];
      for (var i = 0; i < p.length; i += 3) {
        var x = p[i] - c[0],
          y = p[i + 1] - c[1],
          z = p[i + 2] - c[2],
          ahead = Math.cos(a) * z - Math.sin(a) * x;
        out.push(
          (mid + scale * (Math.cos(a) * x + Math.sin(a) * z)).toFixed(1) +
            "," +
            (low + scale * (Math.cos(b) * y - Math.sin(b) * ahead)).toFixed(1),
        );
      }
      if (s[0].localName === "text") {
        s[0].setAttribute("x", out[0].split(",")[0]);
        s[0].setAttribute("y", out[0].split(",")[1]);
      } else s[0].setAttribute("points", out.join(" "));
    });
  }
  function turn(dx, dy) {
    yaw += dx;
    pitch = Math.max(-90, Math.min(90, pitch + dy));
    draw();
  }
  svg.tabIndex = 0;
  var hint = svg.parentNode.querySelector(".turn");
  if (hint) hint.hidden = false;
  svg.onpointerdown = function (e) {
    from = [e.clientX, e.clientY];
    moved = false;
  };
  svg.onpointermove = function (e) {
    if (!from || !(e.buttons & 1)) return;
    var dx = e.clientX - from[0],
      dy = e.clientY - from[1];
    if (!moved && Math.hypot(dx, dy) < 4) return;
    if (!moved) {
      moved = true;
      svg.setPointerCapture(e.pointerId);
    }
    from = [e.clientX, e.clientY];
    turn(-dx / 3, dy / 3);
  };
  svg.onpointerup = svg.onpointercancel = function () {
    from = null;
  };
  svg.addEventListener(
    "click",
    function (e) {
      if (moved) {
        e.preventDefault();
        moved = false;
      }
    },
    true,
  );
  svg.ondragstart = function (e) {
    e.preventDefault();
  };
  svg.onkeydown = function (e) {
    var step = { ArrowLeft: [10, 0], ArrowRight: [-10, 0], ArrowUp: [0, -10], ArrowDown: [0, 10] }[e.key];
    if (step) {
      e.preventDefault();
      turn(step[0], step[1]);
    }
  };
});
