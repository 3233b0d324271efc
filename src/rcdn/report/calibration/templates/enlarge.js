// Opens an enlarged picture in a dialog, which the browser closes on Escape; the arrow keys show the next one.
(function () {
  var links = Array.from(document.querySelectorAll("a.large")),
    dialog = document.createElement("dialog"),
    at = 0;
  if (!links.length || !dialog.showModal) return;
  dialog.className = "views";
  document.body.append(dialog);
  function button(text, act) {
    var b = document.createElement("button");
    b.textContent = text;
    b.onclick = act;
    return b;
  }
  function show(k) {
    at = (k + links.length) % links.length;
    var f = links[at].parentNode.cloneNode(true),
      a = f.querySelector("a.large"),
      bar = document.createElement("div");
    f.removeAttribute("id");
    f.querySelectorAll("[id]").forEach(function (e) {
      e.removeAttribute("id");
    });
    a.replaceWith(a.firstElementChild);
    bar.className = "bar";
    bar.append(
      button("← Previous", function () {
        show(at - 1);
      }),
      button("Next →", function () {
        show(at + 1);
      }),
      button("Close", function () {
        dialog.close();
      }),
    );
    dialog.replaceChildren(bar, f);
    bar.lastChild.focus();
  }
  links.forEach(function (a, k) {
    a.onclick = function (e) {
      if (e.ctrlKey || e.metaKey || e.shiftKey) return;
      e.preventDefault();
      dialog.showModal();
      show(k);
    };
  });
  dialog.onclick = function (e) {
    if (e.target === dialog) dialog.close();
  };
  dialog.onkeydown = function (e) {
    var step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (step) {
      e.preventDefault();
      show(at + step);
    }
  };
})();
